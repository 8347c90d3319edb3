//! `edm-sim replay` as a person meets it: recordings in, tables and pictures out, one line for what cannot be used.

use edm_servo_head::gap::pulses::Class;
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::settings::Settings;
use edm_sim::replay::converter::Gate;
use edm_sim::replay::recording::{Channels, Recording};
use edm_sim::replay::run;
use std::f64::consts::TAU;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn waveform(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("waveforms").join(name)
}

fn replay(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_edm-sim")).arg("replay").args(words).current_dir(folder).output().unwrap()
}

/// Runs on a file with this text: one line on stderr with these parts, exit code 2, nothing written.
fn refused(text: &str, words: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("in.csv"), text).unwrap();
    let mut all = vec!["in.csv", "--out", "out.csv", "--plot", "out.svg"];
    all.extend(words);
    let output = replay(folder.path(), &all);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{text:.80}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    for part in parts {
        assert!(stderr.contains(part), "{part:?} is not in {stderr}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "something was written");
}

/// Our own format at 500 kS/s, with lines put in the place of some (numbered as a person counts them).
fn own(replaced: &[(usize, &str)]) -> String {
    let line = |n: usize| match replaced.iter().find(|(line, _)| *line == n) {
        Some((_, text)) => (*text).to_owned(),
        None if n == 1 => "t_s,gap_v,gate".into(),
        None => format!("{:.6},55.0,1", (n - 2) as f64 * 2e-6),
    };
    (1..=202).map(|n| line(n) + "\n").collect()
}

#[test]
fn what_cannot_be_used_is_named_with_its_line() {
    for (line, text, part) in [
        (7, "0.000010,55.0", "2 columns, where there are 3"),
        (7, "0.000010,55.0,1,9", "4 columns, where there are 3"),
        (7, "0.000010,nan,1", "gap_v = \"nan\": must be a finite number"),
        (7, "0.000010,inf,1", "gap_v = \"inf\""),
        (7, "0.000010,,1", "gap_v = \"\""),
        (7, "0.000010,55 V,1", "gap_v = \"55 V\""),
        (7, "0.000010,55.0,0.5", "gate = 0.5: must be 0 or 1"),
        (7, "soon,55.0,1", "time = \"soon\""),
        (7, "0.000002,55.0,1", "does not come after"),
        (7, "0.000008,55.0,1", "does not come after"),
        (7, "0.0000114,55.0,1", "evenly sampled"),
        (1, "t_s,gap_i", "t_s,gap_i: must be t_s,gap_v[,gap_i][,gate]"),
        (1, "t_s,gap_v,gate,gap_i", "must be t_s,gap_v[,gap_i][,gate]"),
        (1, "time_s,volts,gate", "must be t_s,gap_v[,gap_i][,gate], or what an oscilloscope"),
    ] {
        refused(&own(&[(line, text)]), &[], &["in.csv", &format!("line {line}: "), part]);
    }
    // A gap: a sample is missing. Empty lines count as lines.
    let gap =
        own(&[]).lines().enumerate().filter(|(n, _)| *n != 49).map(|(_, line)| format!("{line}\n")).collect::<String>();
    refused(&gap, &[], &["line 50: ", "without a gap"]);
    refused(&own(&[(5, "\n\n"), (7, "0.000010,nan,1")]), &[], &["line 9: "]);
}

#[test]
fn recordings_without_samples_or_of_a_rate_that_is_not_taken_are_refused() {
    refused("", &[], &["in.csv: is empty"]);
    refused("\n\n", &[], &["in.csv: is empty"]);
    refused("t_s,gap_v\n", &[], &["holds 0 samples"]);
    refused("t_s,gap_v\n0,1\n", &[], &["holds 1 samples"]);
    refused("t_s,gap_v\n0,1\n0.000002,1\n", &[], &["must last 50 us"]);
    refused("t_s,gap_v\n0,1\n0.001,1\n", &[], &["1.0000e3 /s: must be from 1e4 to 1e7 /s"]);
    refused("t_s,gap_v\n0,1\n0.00000005,1\n", &[], &["2.0000e7 /s"]);
    refused("CH1(V),t0 = 0s, tInc = -2e-06s\n1\n2\n", &[], &["must be from 1e4 to 1e7"]);
    refused("X,CH1,Start,Increment\nSequence,Volt,0,soon\n0,1\n", &[], &["line 2", "\"soon\": must be a time in s"]);
    refused(&"no header\n".repeat(100), &[], &["line 1: no header that is known"]);
}

#[test]
fn options_that_make_no_sense_are_refused() {
    let good = own(&[]);
    refused(&good, &["--gate-above", "0"], &["must be a number from 0.1 to 300 V"]);
    refused(&good, &["--gap-i", "CH2"], &["--gap-i CH2: no such channel; there are gap_v, gate"]);
    refused(&good, &["--set", "gap.corner_hz=5"], &["--set gap.corner_hz = 5"]);
    refused(&good, &["--config", "none.toml"], &["--config none.toml: cannot be read"]);
    refused(&good, &["--config", "in.csv"], &["--config in.csv:1: not TOML"]);
    refused(&good, &["--plot", "in.csv"], &["cannot be used multiple times"]);
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("in.csv"), &good).unwrap();
    for words in
        [&["in.csv", "--out", "in.csv"][..], &["in.csv", "--out", "a", "--plot", "a"], &["none.csv", "--out", "a"]]
    {
        let output = replay(folder.path(), words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {output:?}");
        assert_eq!(fs::read_to_string(folder.path().join("in.csv")).unwrap(), good);
    }
}

#[test]
fn every_pulse_of_the_committed_pulses_is_told() {
    let recording = Recording::read(&waveform("pulses.csv"), &Channels::default()).unwrap();
    let replay = run(&recording, &Settings::default(), Gate::AsRecorded).unwrap();
    let told: Vec<Class> = replay.rows.iter().flat_map(|row| row.classes.iter().copied()).collect();
    // As make.py has them in turn.
    let made = [Class::Open, Class::Spark, Class::Arc, Class::Short, Class::Spark];
    assert_eq!(told.len(), 60);
    assert!(told.iter().zip(made.iter().cycle()).all(|(told, made)| told == made), "{told:?}");
    let last = replay.rows.last().unwrap();
    assert_eq!(last.percent(Class::Spark), Some(40.0));
    assert_eq!(replay.pulses, [12, 24, 12, 12, 0, 0]);
}

/// Amplitude of a tone in the second half of a signal of 20 kHz, V.
fn tone(values: &[f32], hertz: f64) -> f64 {
    let half = &values[values.len() / 2..];
    let sum = |shift: f64| {
        let part = |(n, x): (usize, &f32)| f64::from(*x) * (TAU * (hertz * n as f64 / 20_000.0 + shift)).sin();
        half.iter().enumerate().map(part).sum::<f64>() * 2.0 / half.len() as f64
    };
    sum(0.0).hypot(sum(0.25))
}

#[test]
fn the_committed_tones_go_through_low_pass_and_notch_as_they_should() {
    let recording = Recording::read(&waveform("tones.csv"), &Channels::default()).unwrap();
    let replay = run(&recording, &Settings::default(), Gate::AsRecorded).unwrap();
    let column = |value: fn(&edm_sim::replay::Row) -> f32| -> Vec<f32> { replay.rows.iter().map(value).collect() };
    let (low, filtered) = (column(|row| row.lowpass_v), column(|row| row.filtered_v));
    // 8 V of 50 Hz and 4 V of 400 Hz go in; a Butterworth of 200 Hz takes 24.1 dB of the latter.
    let [hum, whistle] = [50.0, 400.0].map(|hertz| tone(&low, hertz));
    assert!((hum - 8.0).abs() < 0.3, "{hum}");
    assert!((whistle - 0.25).abs() < 0.1, "{whistle}");
    assert!(tone(&filtered, 50.0) < 0.2, "{}", tone(&filtered, 50.0));
    assert!(!replay.classified);
}

#[test]
fn the_same_pulses_are_read_from_every_oscilloscope() {
    let channels =
        |gap_i: &str| Channels { gap_i: Some(gap_i.into()), gate: Some("ch3".into()), ..Channels::default() };
    let read = |name: &str| Recording::read(&waveform(name), &channels("CH2")).unwrap();
    let siglent = read("siglent.csv");
    assert_eq!(siglent.gap_v.len(), 400);
    for name in ["rigol.csv", "rigol-memory.csv", "siglent.csv", "tektronix.csv"] {
        let recording = read(name);
        assert!((recording.start_s + 1e-4).abs() < 1e-9 && (recording.rate / 5e5 - 1.0).abs() < 1e-6, "{name}");
        assert_eq!(recording.gate, siglent.gate, "{name}");
        let close = |a: &[f32], b: &[f32]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.6);
        assert!(close(&recording.gap_v, &siglent.gap_v), "{name}");
        assert!(close(recording.gap_i.as_ref().unwrap(), siglent.gap_i.as_ref().unwrap()), "{name}");
        let told = run(&recording, &Settings::default(), Gate::AsRecorded).unwrap().pulses;
        assert_eq!(told, [1, 1, 1, 1, 0, 0], "{name}");
    }
    let tds = Recording::read(&waveform("tektronix-tds.csv"), &Channels::default()).unwrap();
    assert!(tds.gap_v.iter().zip(&siglent.gap_v).all(|(a, b)| (a - b).abs() < 1e-4));
    let error = Recording::read(&waveform("rigol.csv"), &channels("CH4")).unwrap_err();
    assert_eq!(error, "--gap-i CH4: no such channel; there are CH1, CH2, CH3");
    // What older and newer Rigols write in the place of it.
    let folder = tempfile::tempdir().unwrap();
    for head in ["Time,X(CH1),X(CH2),\nSecond,Volt,Volt,\n", "Time(s),CH1(V),CH2(V)\n", "TIME,CH1,CH2\n"] {
        let path = folder.path().join("a.csv");
        fs::write(&path, format!("{head}0.0,1,5\n2e-06,2,6,\n4e-06,3,7\n")).unwrap();
        let channels = Channels { gap_v: Some("CH2".into()), gap_i: Some("CH1".into()), gate: None };
        let recording = Recording::read(&path, &channels).unwrap();
        assert_eq!((recording.gap_v, recording.gap_i), (vec![5.0, 6.0, 7.0], Some(vec![1.0, 2.0, 3.0])), "{head}");
    }
}

#[test]
fn a_replay_is_a_table_a_picture_and_a_summary() {
    let folder = tempfile::tempdir().unwrap();
    let input = waveform("pulses.csv");
    let words = ["--out", "out.csv", "--plot", "out.svg", "--set", "gap.corner_hz=100"];
    let output = replay(folder.path(), &[&[input.to_str().unwrap()], &words[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.contains("12 open, 24 spark, 12 arc, 12 short, 0 uncertain"), "{said}");
    let table = fs::read_to_string(folder.path().join("out.csv")).unwrap();
    let mut rows = csv::Reader::from_reader(table.as_bytes());
    assert_eq!(rows.headers().unwrap(), &edm_sim::replay::COLUMNS[..]);
    let rows: Vec<csv::StringRecord> = rows.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 240);
    assert_eq!(&rows[239][0], "0.01200");
    assert_eq!(&rows[2][5], "open");
    assert!(fs::read_to_string(folder.path().join("out.svg")).unwrap().contains("Pulses that ended in a tick"));
}

#[test]
fn a_replay_runs_what_the_settings_say() {
    let recording = Recording::read(&waveform("pulses.csv"), &Channels::default()).unwrap();
    let mean = |settings: &Settings, gate| {
        let replay = run(&recording, settings, gate).unwrap();
        replay.rows.iter().map(|row| row.decimated_v).sum::<f32>() / replay.rows.len() as f32
    };
    // Plain averages fall with the share of the on-time, 60 %.
    let plain = mean(&Settings { gap_average: Average::Plain, ..Settings::default() }, Gate::AsRecorded);
    let gated = mean(&Settings::default(), Gate::AsRecorded);
    assert!((plain / gated - 0.6).abs() < 0.03, "{plain} of {gated} V");
    // With a gate made of the voltage the shorts do not count.
    assert!(mean(&Settings::default(), Gate::Above(12.0, 1e6)) > gated + 5.0);
}
