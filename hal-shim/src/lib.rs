//! What the control core asks of hardware, in raw units: counts, converter codes, clock ticks.
//!
//! Each trait is the whole contract with one piece of hardware. Where the embedded-hal or embedded-can project has a trait,
//! that trait is used: pins and PWM of the H-bridge ([`bridge::PwmBridge`]), CAN ([`can`]), flash ([`storage`]).
//!
//! Rules for every implementation: nothing blocks without a bound, nothing allocates, and a value that is not available is
//! reported, never replaced by zero.
#![cfg_attr(not(any(test, feature = "double")), no_std)]
#![deny(unsafe_code)]

pub mod backup;
pub mod board;
pub mod bridge;
pub mod can;
pub mod clock;
#[cfg(feature = "double")]
pub mod double;
pub mod edges;
pub mod encoder;
pub mod gap;
pub mod gap_filter;
pub mod generator;
pub mod live;
pub mod pause;
pub mod reflex;
pub mod safety;
pub mod seal;
pub mod self_test;
pub mod stage;
pub mod steps;
#[cfg(all(target_arch = "arm", feature = "chip"))]
#[allow(unsafe_code, reason = "registers, the two flash sectors, the core-coupled memory, the gap filter in assembly")]
pub mod stm32f4;
pub mod storage;
pub mod task_watchdog;
pub use edm_store as store;
pub mod tick;
pub mod timing;
pub mod watchdog;
