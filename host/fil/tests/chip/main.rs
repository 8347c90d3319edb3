//! The modelled chip and the firmware on it. One program: each would be linked with the emulator by itself.

use edm_hal_shim::gap_filter;

mod bore;
mod bursts;
mod bus;
mod classes;
mod common;
mod counts;
mod coupling;
mod cycles;
mod edges;
mod engine;
mod frames;
mod identify;
mod live;
mod locks;
mod lockstep;
mod lss;
mod mutants;
mod notch;
mod pauses;
mod pulses;
mod reflex;
mod resume;
mod scope;
mod self_test;
mod snapshot;
mod stack;
mod steps;
mod supply;
mod tune;
mod update;
