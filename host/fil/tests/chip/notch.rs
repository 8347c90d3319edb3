//! The notch that follows the mains, on the chip: hum of a drifting frequency on a gap without pulses.
//!
//! `EDM_NOTCH_S` is how long each case is measured, s, after 10 s to find the hum.

use crate::common;
use edm_fil::host;
use edm_fil::image::Image;
use edm_fil::rig::{Emulated, Witness};
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::settings::{Declared as _, Settings, Value};
use edm_sim::machine::Rig as _;
use edm_sim::run::Setup;

const SECOND: usize = 20_000;
/// Seconds to find the hum.
const FINDS: usize = 5;
/// Amplitude of the hum, V, and how far its frequency drifts either way, at 0.1 Hz/s.
const HUM: f64 = 10.0;
const DRIFTS: f64 = 0.5;
/// As `tests/gates/gap/notch.rs` wants it, dB.
const BOUND_DB: f64 = 40.0;
/// Objects of the settings: notch the second harmonic, follow the mains.
const HARMONIC: u8 = 7;
const FOLLOW: u8 = 23;

/// A disabled head that reads a gap with so much hum and noise, V.
fn reads(hum: f64, mains: f64, drift: f64, noise: f64, settings: Settings) -> Emulated {
    let image = Image::parse(common::firmware().to_vec()).unwrap();
    let mut plant = Setup::load("sinker").unwrap().process;
    for (key, value) in [("hum_v", hum), ("mains_hz", mains), ("mains_drift_hz", drift), ("noise_v", noise)] {
        plant.set(&format!("front_end.{key}"), Value::Number(value)).unwrap();
    }
    let settings = Settings { commissioned: true, gap_average: Average::Plain, ..settings };
    let mut rig = Emulated::start(&image, plant, &settings, 1, Witness::None).unwrap();
    host::begin(&mut rig).unwrap();
    rig
}

fn seconds() -> usize {
    std::env::var("EDM_NOTCH_S").ok().and_then(|seconds| seconds.parse().ok()).unwrap_or(2)
}

/// What is left of the hum in the filtered voltage in the worst of so many seconds, dB below it.
fn attenuation(rig: &mut Emulated, seconds: usize) -> f64 {
    let second = |rig: &mut Emulated| {
        let volts: Vec<f64> = (0..SECOND)
            .map(|_| {
                rig.tick().unwrap();
                f64::from(rig.status().gap.filtered.0)
            })
            .collect();
        let mean = volts.iter().sum::<f64>() / SECOND as f64;
        let square = volts.iter().map(|volts| (volts - mean).powi(2)).sum::<f64>() / SECOND as f64;
        -10.0 * (2.0 * square / (HUM * HUM)).log10()
    };
    (0..seconds).map(|_| second(rig)).fold(f64::INFINITY, f64::min)
}

/// Where the notch is, Hz, and whether it follows.
fn notch(rig: &mut Emulated) -> (f64, bool) {
    let [hertz, follows] = [9, 10].map(|sub| host::read(rig, 0x2012, sub).unwrap());
    (f64::from(hertz & 0xFFFF) / 100.0, follows & 1 == 1)
}

fn wait(rig: &mut Emulated, seconds: usize) {
    (0..seconds * SECOND).for_each(|_| rig.tick().unwrap());
}

#[test]
fn the_notch_follows_a_drifting_hum_as_in_the_report() {
    let measured = seconds();
    for mains in [50.0, 60.0] {
        let settings = Settings { gap_follow_mains: true, ..Settings::default() };
        let mut rig = reads(HUM, mains, DRIFTS, 0.0, settings);
        wait(&mut rig, FINDS);
        let left = attenuation(&mut rig, measured);
        let (hertz, follows) = notch(&mut rig);
        println!("notch: {mains} Hz: {left:.1} dB in the worst of {measured} s, now at {hertz} Hz");
        assert!(left >= BOUND_DB && follows && (hertz - mains).abs() < 1.0, "{mains} Hz: {left} dB, {hertz} Hz");
    }
}

#[test]
fn without_hum_the_notch_stays_where_it_is() {
    let settings = Settings { gap_follow_mains: true, ..Settings::default() };
    // 5 V of a conversion are 1 V of a tick.
    let mut rig = reads(0.0, 50.0, 0.0, 5.0, settings);
    let mut most = 0.0f64;
    for _ in 0..seconds() {
        wait(&mut rig, 1);
        most = most.max((notch(&mut rig).0 - 50.0).abs());
    }
    println!("notch: {most:.2} Hz off without hum");
    assert!(most <= 0.1, "{most} Hz");
}

#[test]
fn following_and_the_second_harmonic_come_and_go_without_a_step() {
    // On the frequency that is set: with or without, nothing but the notch's own ringing may show.
    let mut rig = reads(HUM, 50.0, 0.0, 0.0, Settings::default());
    wait(&mut rig, 1);
    for (sub, on) in [(FOLLOW, 1), (HARMONIC, 1), (HARMONIC, 0), (FOLLOW, 0)] {
        let before = attenuation(&mut rig, 1);
        host::write(&mut rig, 0x2100, sub, on, 1).unwrap();
        let after = attenuation(&mut rig, 1);
        println!("notch: 2100h:{sub} = {on}: {before:.1} dB before, {after:.1} dB with the change");
        assert!(after >= BOUND_DB, "2100h:{sub} = {on}: {after} dB");
    }
    assert!(!notch(&mut rig).1);
}

#[test]
fn the_second_harmonic_moves_with_the_notch() {
    let settings = Settings { gap_follow_mains: true, gap_second_harmonic: true, ..Settings::default() };
    let mut rig = reads(HUM, 60.0, 0.0, 0.0, settings);
    wait(&mut rig, FINDS);
    let left = attenuation(&mut rig, 1);
    // The chip's own coefficients: those of the second harmonic of 60 Hz take out nothing at 100 Hz.
    let (hertz, follows) = notch(&mut rig);
    println!("notch: with the second harmonic, 60 Hz: {left:.1} dB, at {hertz} Hz");
    assert!(left >= BOUND_DB && follows && (hertz - 60.0).abs() < 0.1, "{left} dB, {hertz} Hz");
}
