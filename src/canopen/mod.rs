//! The head as a CANopen device: the CiA 402 drive and the EDM objects behind a node by CiA 301.
//!
//! The node is the package [`edm_canopen`], which knows nothing of this head; all that it exports is found here as well.
//! Here are the [`drive`], which is the [`Dictionary`] behind it, the declarations of its [`objects`], and the files that
//! describe the whole device to others, EDS and DBC.

#[cfg(not(target_os = "none"))]
pub mod dbc;
pub mod drive;
#[cfg(not(target_os = "none"))]
pub mod eds;
pub mod objects;
#[cfg(not(target_os = "none"))]
mod remarks;

pub use edm_canopen::*;
