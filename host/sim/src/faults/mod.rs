//! Fault campaigns: what is injected, what the head made of it, and the page that says so.
//!
//! | file | responsible for |
//! | --- | --- |
//! | `row` | a fault and what became of it, as JSON and as a table; how rows are counted |

pub mod row;
