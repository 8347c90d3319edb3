//! `edm-sim replay` as a person meets it: recordings in, tables and pictures out, one line for what cannot be used.

use edm_servo_head::gap::pulses::{Class, Fit};
use edm_servo_head::gap::voltage::Average;
use edm_servo_head::settings::Settings;
use edm_sim::replay::converter::Gate;
use edm_sim::replay::recording::{Channels, Recording};
use edm_sim::replay::run;
use std::f64::consts::TAU;
use std::fs;
use std::io::{self, Read};
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
        (7, "0.000002,55.0,1", "is not after"),
        (7, "0.000008,55.0,1", "is not after"),
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
    refused("t_s,gap_v\n", &[], &["has 0 samples"]);
    refused("t_s,gap_v\n0,1\n", &[], &["has 1 samples"]);
    refused("t_s,gap_v\n0,1\n0.000002,1\n", &[], &["must last at least a servo tick, 50 us"]);
    refused("t_s,gap_v\n0,1\n0.001,1\n", &[], &["1.0000e3 /s: must be from 1e4 to 1e7 /s"]);
    refused("t_s,gap_v\n0,1\n0.00000005,1\n", &[], &["2.0000e7 /s"]);
    refused("CH1(V),t0 = 0s, tInc = -2e-06s\n1\n2\n", &[], &["must be from 1e4 to 1e7"]);
    refused("X,CH1,Start,Increment\nSequence,Volt,0,soon\n0,1\n", &[], &["line 2", "\"soon\": must be a time in s"]);
    refused(&"no header\n".repeat(100), &[], &["line 1: no known header"]);
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
    // And as the head itself counts them.
    assert_eq!(replay.counted.map(u64::from), replay.pulses);
}

#[test]
fn pulses_that_the_levels_do_not_fit_are_uncertain_as_on_the_head() {
    // The committed pulses over and over, for as many looks as are needed.
    let mut recording = Recording::read(&waveform("pulses.csv"), &Channels::default()).unwrap();
    fn again<T: Copy>(values: &[T]) -> Vec<T> {
        values.iter().copied().cycle().take(80 * values.len()).collect()
    }
    recording.gap_v = again(&recording.gap_v);
    recording.gap_i = recording.gap_i.as_deref().map(again);
    recording.gate = recording.gate.as_deref().map(again);
    let levels = |open: f32| Settings { gap_open: open, ..Settings::default() };
    let [good, bad] = [100.0, 130.0].map(|open| run(&recording, &levels(open), Gate::AsRecorded).unwrap());
    assert_eq!((good.fit, good.pulses[Class::Uncertain as usize]), (Fit::Fits, 0));
    // No pulse of these waits as no arc does: nothing is learned.
    assert_eq!(bad.fit, Fit::DoesNotFit);
    let said = bad.summary(&recording);
    assert!(bad.pulses[Class::Uncertain as usize] > 900 && said.contains("do not fit"), "{said}");
    for replay in [good, bad] {
        assert_eq!(replay.counted.map(u64::from), replay.pulses);
    }
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

/// Three samples, 2 us apart, as others write them: gap voltage 1500, -20 and 0.4 V, current 5, 6 and 7 A.
const EXPORTS: [(&str, &str, &str, &str); 13] = [
    ("Rigol, mV", "Time(s),CH1(mV),CH2(A)\n0.0,1500000,5\n2e-06,-20000,6\n4e-06,400,7\n", "CH1", "CH2"),
    ("Rigol, memory in kV", "CH1(kV),CH2(mA),t0 = 0s, tInc = 2e-06s,\n1.5,5000\n-0.02,6000\n4e-4,7000\n", "CH1", "CH2"),
    (
        "Rigol DS1000Z",
        "X,CH1,CH2,Start,Increment,\nSequence,mV,A,0,2e-6\n0,1500000,5\n1,-20000,6\n2,400,7\n",
        "CH1",
        "CH2",
    ),
    ("quoted", "\"Time (us)\",\"CH1 (V)\",\"CH2 (A)\"\r\n0,1500,5\r\n\"2\",-20,\"6\"\r\n4,.4,7\r\n", "CH1", "CH2"),
    (
        "Siglent",
        "Record Length,Analog:3\nVertical Units,CH1:mV,CH2:A,\nSource,CH1,CH2\nSecond,Value,Value\n\
      0,1500000,5\n0.000002,-20000,6\n0.000004,400,7\n",
        "CH1",
        "CH2",
    ),
    (
        "Tektronix",
        "Model,MDO3014\nHorizontal Units,us\nRecord Length,3,3\nVertical Units,V,mA\n,,\nTIME,CH1,CH2\n\
      0,1500,5000\n2,-20,6000\n4,0.4,7000\n",
        "CH1",
        "CH2",
    ),
    (
        "PicoScope 6",
        "Time,Channel A,Channel B\n(\u{b5}s),(V),(mA)\n\n0,1500,5000\n2,-20,6000\n4,0.4,7000\n",
        "Channel A",
        "channel b",
    ),
    (
        "PicoScope 7",
        "Time,Channel A,Channel B\n(ms),(mV),(A)\n\n-0.1,1500000,5\n-0.098,-20000,6\n-0.096,400,7\n",
        "Channel A",
        "Channel B",
    ),
    ("Rohde & Schwarz", "in s,C1 in V,C2 in A\n0,1.5E3,5\n2E-06,-2E1,6\n4E-06,4E-1,7\n", "C1", "C2"),
    (
        "sigrok, units",
        "; CSV generated by libsigrok 0.5.2\n; from Demo on Mon Jan  1\n; Channels (2/8): A0, A1\n; Samplerate: 500 kHz\n\
      microseconds,V DC,A\n2,1500,5\n4,-20,6\n6,0.4,7\n",
        "A0",
        "A1",
    ),
    (
        "sigrok, names",
        "; CSV generated by libsigrok 0.5.2\n; Samplerate: 500 kHz\nTime,A0,A1\n2,1500,5\n4,-20,6\n6,0.4,7\n",
        "A0",
        "A1",
    ),
    (
        "sigrok, no times",
        "; CSV generated by libsigrok 0.6.0\n; Samplerate: 500 kHz\nmV,A\n1500000,5\n-20000,6\n400,7\n",
        "CH1",
        "CH2",
    ),
    (
        "Saleae",
        "Time [s],Channel 0,Channel 1\n-0.000002000,1500,5\n0.000000000,-20,6\n0.000002000,0.4,7\n",
        "Channel 0",
        "Channel 1",
    ),
];

/// Reads a text, with these channels.
fn read(text: &[u8], channels: [Option<&str>; 3]) -> Result<Recording, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    fs::write(&path, text).unwrap();
    let [gap_v, gap_i, gate] = channels.map(|name| name.map(String::from));
    Recording::read(&path, &Channels { gap_v, gap_i, gate })
}

#[test]
fn the_unit_of_a_column_is_read_from_the_header_of_every_export() {
    for (name, text, gap_v, gap_i) in EXPORTS {
        let recording =
            read(text.as_bytes(), [Some(gap_v), Some(gap_i), None]).unwrap_or_else(|e| panic!("{name}: {e}"));
        let close = |values: &[f32], wanted: [f32; 3]| {
            values.len() == 3 && values.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= 1e-5 * b.abs())
        };
        assert!((recording.rate / 5e5 - 1.0).abs() < 1e-6, "{name}: {} /s", recording.rate);
        assert!(close(&recording.gap_v, [1500.0, -20.0, 0.4]), "{name}: {:?} V", recording.gap_v);
        assert!(close(recording.gap_i.as_ref().unwrap(), [5.0, 6.0, 7.0]), "{name}: {:?} A", recording.gap_i);
    }
    // A Hantek writes a channel a file; its micro sign, as others', may be of another character set.
    for text in [
        &b"#timebase=200000(ps)\n,#voltbase=5000000(uV)\n#size=3\n0.0,1.5\n2e-06,2.5\n4e-06,3.5\n"[..],
        b"#CHANNEL:CH2\n#CLOCK=0.000002000S\n#SIZE=3\n#UNITS:V\n\n1.5\n2.5\n3.5\n",
        b"Time,Channel A\n(\xb5s),(V)\n\n0,1.5\n2,2.5\n4,3.5\n",
    ] {
        let recording = read(text, [None; 3]).unwrap();
        assert!((recording.rate / 5e5 - 1.0).abs() < 1e-6, "{} /s", recording.rate);
        assert_eq!(recording.gap_v, [1.5, 2.5, 3.5]);
    }
}

#[test]
fn a_gate_of_levels_is_open_at_1_and_one_of_volts_from_half_of_the_logic_on() {
    let sigrok = "; CSV generated by libsigrok 0.5.2\n; Channels (2/9): A0, D3\n; Samplerate: 500 kHz\n";
    for text in [
        format!("{sigrok}microseconds,V,logic\n2,40,0\n4,40,1\n"),
        format!("{sigrok}Time,A0,D3\n2,40,0\n4,40,1\n"),
        "Time(s),A0(V),D3(mV)\n0,40,1400\n2e-6,40,1600\n".into(),
    ] {
        assert_eq!(read(text.as_bytes(), [None, None, Some("D3")]).unwrap().gate, Some(vec![false, true]), "{text}");
    }
}

#[test]
fn a_unit_that_a_column_may_not_have_and_rows_that_are_missing_are_refused() {
    let in_unit = |unit: &str| format!("Time(s),CH1({unit}),CH2(V)\n0,1,1\n2e-6,1,1\n");
    refused(&in_unit("dB"), &[], &["gap_v: CH1 is in \"dB\": must be in V"]);
    refused(&in_unit("A"), &[], &["gap_v: CH1 is in \"A\": must be in V"]);
    refused(&in_unit("A"), &["--gap-v", "CH2", "--gate", "CH1"], &["gate: CH1 is in \"A\""]);
    refused("Time(Hz),CH1(V)\n0,1\n", &[], &["line 1: Time(Hz): must be in s"]);
    refused(
        "Record Length,Analog:1000\nSource,CH1\nSecond,Volt\n0,1\n2e-6,1\n",
        &[],
        &["line 1: announces 1000 samples, the file has 2"],
    );
    refused(
        "#timebase=1(ps)\n,#voltbase=1(uV)\n#size=1\n0,1\n2e-6,1\n",
        &[],
        &["line 3: announces 1 samples, the file has 2"],
    );
    refused("#CHANNEL:CH1\n#CLOCK=soon\n1\n", &[], &["line 2: #CLOCK=soon: must be a time in s"]);
}

#[test]
fn a_line_or_a_cell_without_an_end_is_refused_before_it_is_held_in_memory() {
    let digits = |count: usize| "1".repeat(count);
    refused(&digits(300), &[], &["line 1: 11111111111111111111..: a cell of 300 bytes: at most 256"]);
    refused(&format!("t_s,gap_v\n0,{}\n", digits(300)), &[], &["line 2: ", "a cell of 300 bytes"]);
    refused(&format!("t_s,gap_v\n0,1{}", ",1".repeat(40_000)), &[], &["line 2: longer than 65536 bytes"]);
    // A line of 1 GiB: what is read of it is what shows that it is too long, and the rest of a buffer.
    const WHOLE: u64 = 1 << 30;
    let mut rest = io::repeat(0).take(WHOLE);
    let error = Recording::read_from(&mut rest, &Channels::default()).unwrap_err();
    assert_eq!(error, "line 1: longer than 65536 bytes: must be a table of samples");
    let taken = WHOLE - rest.limit();
    assert!(taken <= 65_537 + 8192, "{taken} bytes");
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
    assert!(fs::read_to_string(folder.path().join("out.svg")).unwrap().contains("Pulses that ended, per tick"));
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
