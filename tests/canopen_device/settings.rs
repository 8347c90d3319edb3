//! Settings as objects: ranges, conflicts, storage.

use crate::rig::Rig;
use edm_servo_head::canopen::drive::Kept;
use edm_servo_head::canopen::objects::setting_address;

fn address(key: &str) -> (u16, u8) {
    setting_address(key).unwrap()
}

#[test]
fn a_setting_out_of_range_is_refused_with_the_code_that_says_which_way() {
    let mut rig = Rig::new(|_, _| {});
    let (index, sub) = address("gap.corner_hz");
    assert_eq!(rig.try_write(index, sub, &2000.1f32.to_le_bytes()), Err(0x0609_0031));
    assert_eq!(rig.try_write(index, sub, &19.9f32.to_le_bytes()), Err(0x0609_0032));
    assert_eq!(rig.try_write(index, sub, &f32::NAN.to_le_bytes()), Err(0x0609_0030));
    assert_eq!(rig.read_real((index, sub)), 200.0);
    rig.write(index, sub, &2000.0f32.to_le_bytes());
    assert_eq!(rig.read_real((index, sub)), 2000.0);
    let (index, sub) = address("feed.law");
    assert_eq!(rig.try_write(index, sub, &[3]), Err(0x0609_0031));
    rig.write(index, sub, &[0]);
    assert_eq!(rig.read(index, sub), 0);
    let (index, sub) = address("commission.passed");
    assert_eq!(rig.try_write(index, sub, &[1]), Err(0x0601_0002));
}

#[test]
fn a_setting_at_odds_with_another_is_refused_and_named() {
    let mut rig = Rig::new(|_, _| {});
    let (index, sub) = address("servo.position_hz");
    assert_eq!(rig.try_write(index, sub, &100.0f32.to_le_bytes()), Err(0x0604_0043));
    assert_eq!(rig.read_real((index, sub)), 40.0);
    assert_eq!(rig.read(0x2002, 1), u32::from(index) << 8 | u32::from(sub));
}

#[test]
fn following_error_window_and_setting_are_the_same() {
    let mut rig = Rig::new(|_, _| {});
    assert_eq!(rig.read(0x6065, 0), 200);
    rig.write32(0x6065, 0, 150);
    assert_eq!(rig.read_real(address("supervise.following_um")), 150.0);
    assert_eq!(rig.try_write(0x6065, 0, &[0; 4]), Err(0x0609_0032));
}

#[test]
fn what_is_stored_survives_a_reset_and_what_is_not_does_not() {
    let mut rig = Rig::new(|_, _| {});
    let gain = address("feed.gain_um_s_v");
    rig.write(gain.0, gain.1, &12.5f32.to_le_bytes());
    rig.write(0x6081, 0, &4321u32.to_le_bytes());
    rig.write(0x1010, 1, b"save");
    rig.write(0x6081, 0, &1u32.to_le_bytes());
    rig.send(0, &[129, 5]);
    rig.run(5);
    assert_eq!(rig.read(0x6081, 0), 4321);
    assert_eq!(rig.read_real(gain), 12.5);
    rig.write(0x1011, 1, b"load");
    rig.send(0, &[129, 5]);
    rig.run(5);
    assert_eq!(rig.read(0x6081, 0), 10_000);
    assert_eq!(rig.read_real(gain), 20.0);
}

#[test]
fn nothing_is_stored_while_the_drive_is_enabled() {
    let mut rig = Rig::ready();
    assert_eq!(rig.try_write(0x1010, 1, b"save"), Err(0x0800_0022));
    assert_eq!(rig.kept, Kept::NOTHING);
}

#[test]
fn another_mass_asks_for_another_guided_check() {
    let mut rig = Rig::new(|_, _| {});
    let mass = address("axis.mass_kg");
    let passed = address("commission.passed");
    assert_eq!(rig.read(passed.0, passed.1) & 0xFF, 1);
    rig.write(mass.0, mass.1, &0.25f32.to_le_bytes());
    assert_eq!(rig.read(passed.0, passed.1) & 0xFF, 0);
    for word in [0x06, 0x07, 0x0F] {
        rig.control(word);
    }
    rig.run(5);
    assert_eq!(rig.status() & 0x6F, 0x23);
    assert_eq!(rig.read(0x2000, 4), 2, "the guided check has not passed");
}
