//! The head as a CANopen device: the CiA 402 drive and the EDM objects behind a node by CiA 301.
//!
//! The node is the package [`edm_canopen`], which knows nothing of this head; all that it exports is found here as well.
//! Here are the [`drive`], which is the [`Dictionary`] behind it, and the declarations of its [`objects`]. The description files
//! of all this, EDS and DBC, are made in host/describe.

pub mod drive;
pub mod objects;

pub use edm_canopen::*;
