//! Control core of an EDM servo head: everything between raw converter codes and a signed duty.
//!
//! The core is `no_std`, allocates nothing, holds no `unsafe` and cannot panic in a tick. It runs unchanged on the
//! STM32F405/407, natively against the process model of `host/sim`, and as part of the firmware image on a modelled chip.
//! Rooms know only the rooms above them:
//!
//! | room | responsible for |
//! | --- | --- |
//! | [`units`] | quantities and the only scale factors |
//! | [`kept`] | settings that a task runs, kept twice |
//! | [`dsp`] | filters: coefficients and state apart |
//! | [`encoder`] | quadrature decoding, index marks, velocity, plausibility |
//! | [`gap`] | gap sources: converter codes to one [`gap::GapReading`] |
//! | [`feed`] | feed laws: gap reading to path velocity |
//! | [`path`] | segments and the register that shifts both ways |
//! | [`motion`] | profiles and homing: axis positioning |
//! | [`servo`] | position and velocity loops, limits |
//! | [`head`] | states, fault reactions, supervision; wires the rooms together |
//! | [`scope`] | signals of the servo tick, recorded around a trigger or a fault |
//! | [`settings`] | what a person sets, checked and built into what the ticks run |
//! | [`technology`] | rows of settings from roughing to finishing, for one hole |
//! | [`stored`] | what outlives the power: one image, a list of objects with their values |
//! | [`backup`] | what survives a power cut in the memory with a cell: the hole, the work done |
//! | [`canopen`] | the head as a CANopen device: drive and objects behind the node of [`edm_canopen`] |
//!
//! Sources, cited in the documentation by letter and section: \[R\] Roberts 2014, gap-voltage servo on a short-stroke linear
//! actuator (thesis); \[L\] Lemeni, quadrature front end; \[X\] Xin et al. 2018, gap distance from the RC charging time;
//! \[G\] Gao et al. 2024, feed-pulse collaborative control; \[A\] Amra 2013, distributed CAN modules of a machine tool.
#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]

pub mod backup;
pub mod canopen;
pub mod dsp;
pub mod encoder;
pub mod feed;
pub mod gap;
pub mod head;
pub mod kept;
pub mod motion;
pub mod path;
pub mod scope;
pub mod servo;
pub mod settings;
pub mod stored;
pub mod technology;
pub mod units;
