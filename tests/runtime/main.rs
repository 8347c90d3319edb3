//! What crosses between the tasks of a head, under a scheduler that lets every lower task come late and be interrupted at
//! each crossing (`edm_sim::schedule`): the dictionary reads what runs, every request is answered, nothing is lost uncounted.

mod bursts;
mod late_plans;
mod live;
mod losses;
mod rig;
mod self_test;
mod settings_damaged;
mod update;
mod writes;
