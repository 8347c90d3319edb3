//! The CANopen node, spoken to by frames alone (CiA 301 version 4.2).

mod bench;
mod block;
mod flood;
mod lss;
mod machine;
mod mapping;
mod network;
mod oracle;
mod process_data;
mod sdo;
mod services;
mod store;
mod update;
mod watched;
