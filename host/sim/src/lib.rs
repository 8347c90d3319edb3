//! Process model and native closed loop.
