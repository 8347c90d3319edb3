//! The run in words (docs/glossary.md).

use super::Report;
use crate::run::RowOutcome;
use std::fmt;

/// A short table of the main figures.
#[derive(Clone, Copy, Debug)]
pub struct Summary<'a> {
    /// The run.
    pub report: &'a Report,
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let report = self.report;
        let mut row = |name: &str, words: String| writeln!(f, "  {name:<12} {words}");
        row("Hole", self.hole())?;
        row("Electrode", self.electrode())?;
        for words in self.verdict() {
            row("Verdict", words)?;
        }
        row("Time", self.time())?;
        for run in &report.rows {
            row("Row", one_row(run))?;
        }
        row("Gap voltage", self.voltage())?;
        row("Gap", self.gap())?;
        row("Position", self.position())?;
        row("Pulses", self.pulses())?;
        row("Fluid", self.fluid())?;
        if let Some(words) = self.jumps() {
            row("Jumps", words)?;
        }
        if report.inches > 0 {
            row("Coarse axis", format!("{} moves, head carried by {:.3} mm", report.inches, report.carried_mm))?;
        }
        row("Encoder", self.encoder())?;
        if report.faults.is_empty() {
            row("Faults", "none".into())?;
        }
        for fault in &report.faults {
            row("Fault", format!("{} at {}", fault.fault, duration(fault.t_s)))?;
        }
        Ok(())
    }
}

impl Summary<'_> {
    fn hole(&self) -> String {
        match self.report.hole_depth_mm {
            Some(depth) if depth >= 0.0005 => format!("{depth:.3} mm deep (simulated)"),
            Some(_) => "no hole (simulated)".into(),
            None => "of unknown depth".into(),
        }
    }

    fn electrode(&self) -> String {
        let report = self.report;
        let depth = match report.depth_mm {
            Some(depth) if depth >= 0.0005 => format!("{depth:.3} mm deep"),
            Some(_) => "not below the surface".into(),
            None => "of unknown depth".into(),
        };
        let worn = match report.wear_mm {
            Some(worn) if worn >= 0.000_5 => format!(", {worn:.3} mm worn"),
            _ => String::new(),
        };
        let wanted = format!("{depth}{worn}, {:.3} mm requested", report.target_depth_mm);
        match report.stop_reason.as_str() {
            "depth reached" | "end of the path" => wanted,
            reason if report.completed => format!("{wanted}; {reason}"),
            reason => format!("{wanted}, stopped: {reason}"),
        }
    }

    /// Whether all figures are within their limits, or which are not.
    fn verdict(&self) -> Vec<String> {
        let report = self.report;
        let mut words: Vec<String> = report.findings.iter().map(|finding| finding.text.clone()).collect();
        if !report.completed {
            words.insert(0, format!("stopped: {}", report.stop_reason));
        } else if report.gap_voltage_v.mean.is_none() {
            words.push("not evaluated: less than two seconds of undisturbed eroding".into());
        }
        if words.is_empty() {
            words.push("steady: all figures within their limits".into());
        }
        words
    }

    fn time(&self) -> String {
        let report = self.report;
        let rate = match report.rate_mm_min {
            Some(rate) if rate > 0.0 => format!(", {rate:.2} mm/min while eroding"),
            _ => String::new(),
        };
        let speed = report.sim_time_s / report.wall_time_s.max(1e-3);
        let wall = report.wall_time_s;
        format!(
            "{} on the machine{rate}; simulated in {wall:.1} s, {speed:.0} times real time",
            duration(report.sim_time_s)
        )
    }

    fn voltage(&self) -> String {
        let voltage = &self.report.gap_voltage_v;
        match (voltage.mean, voltage.setpoint, voltage.rms_error_100ms) {
            (Some(mean), Some(setpoint), Some(error)) => {
                format!(
                    "mean {mean:.1} V, set point {setpoint:.1} V; 100 ms mean: {error:.1} V rms about the set point"
                )
            }
            (Some(mean), ..) if !self.report.rows.is_empty() => format!("mean {mean:.1} V of all rows"),
            (Some(mean), ..) => format!("mean {mean:.1} V; no set point: the feed law goes by something else"),
            _ => "not evaluated: less than two seconds of undisturbed eroding".into(),
        }
    }

    fn gap(&self) -> String {
        match (self.report.gap_um.mean, self.report.gap_um.rms_error) {
            (Some(mean), Some(error)) => format!("mean {mean:.0} um, {error:.1} um rms about it"),
            _ => "not evaluated".into(),
        }
    }

    fn position(&self) -> String {
        let report = self.report;
        let moves = match report.long_retreats {
            0 => "no backward move of more than 5 um".into(),
            1 => "1 backward move of more than 5 um".into(),
            n => format!("{n} backward moves of more than 5 um"),
        };
        let Some(ripple) = report.position_pp_um_median else { return format!("not evaluated; {moves}") };
        let line = match (report.position_line_um.amplitude, report.position_line_um.hz) {
            (Some(um), Some(hz)) => format!("; largest tone {um:.1} um at {hz:.0} Hz"),
            _ => String::new(),
        };
        let vibration =
            report.vibration_mm_s.map_or_else(String::new, |mm_s| format!("; {mm_s:.2} mm/s rms above 50 Hz"));
        format!("ripple {ripple:.1} um p-p (0.5 s window){line}{vibration}; {moves}")
    }

    fn jumps(&self) -> Option<String> {
        match (self.report.jumps, self.report.jumps_cramped) {
            (0, false) => None,
            (0, true) => Some(
                "none: no room above the work, or the axis is not homed; lower jump.height_um, or start deeper in the stroke".into(),
            ),
            (n, false) => Some(n.to_string()),
            (n, true) => Some(format!("{n}, lower than jump.height_um: the stroke limits the height")),
        }
    }

    fn pulses(&self) -> String {
        let report = self.report;
        let (Some(open), Some(spark), Some(arc), Some(short)) =
            (report.open_ratio, report.spark_ratio, report.arc_ratio, report.short_ratio)
        else {
            return "no pulses".into();
        };
        format!(
            "{} discharges; {} sparks, {} open, {} arcs, {} shorts",
            grouped(report.discharges),
            percent(spark),
            percent(open),
            percent(arc),
            percent(short),
        )
    }

    fn fluid(&self) -> String {
        let report = self.report;
        let debris = report.debris_mean.map_or_else(|| "not evaluated".into(), |dirt| format!("{:.1} %", 5.0 * dirt));
        let damage = match report.damage_mean {
            Some(damage) if damage > 0.0 => format!(", arc damage {damage:.2}"),
            _ => String::new(),
        };
        let pit = match report.pit_um {
            Some(pit) if pit > 0.0 => format!(", deepest pit of arcs {pit:.1} um"),
            _ => String::new(),
        };
        let through = match report.through_ratio {
            share if share > 0.0 => format!("; {} of the face is through", percent(share)),
            _ => String::new(),
        };
        let (film, contact) = (report.film_n_max, report.contact_n_max);
        format!(
            "debris {debris} by volume{damage}{pit}{through}; largest force {film:.1} N of the film, {contact:.1} N of contact"
        )
    }

    fn encoder(&self) -> String {
        match (self.report.lost_counts, self.report.illegal_transitions) {
            (0, 0) => "no lost count, no illegal transition".into(),
            (lost, illegal) => format!("{lost} counts lost, {illegal} illegal transitions"),
        }
    }
}

/// A row of a technology table.
fn one_row(row: &RowOutcome) -> String {
    format!(
        "{}: {}, to {:.3} mm ({:+} counts); gap {:.0} um at {:.1} V, {} sparks, {} arcs, craters {:.1} um",
        row.name,
        duration(row.to_s - row.from_s),
        row.depth_mm,
        row.off_counts,
        row.gap_um,
        row.gap_v,
        percent(row.spark_ratio),
        percent(row.arc_ratio),
        row.crater_um,
    )
}

/// "2 min 31 s", "12.3 s".
fn duration(seconds: f64) -> String {
    if seconds < 60.0 {
        return format!("{seconds:.1} s");
    }
    let whole = seconds.round();
    format!("{:.0} min {:02.0} s", (whole / 60.0).floor(), whole % 60.0)
}

/// "712 340".
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// Whole per cent, but never zero for a share above zero.
fn percent(share: f64) -> String {
    match share * 100.0 {
        x if x > 0.0 && x < 0.1 => "< 0.1 %".into(),
        x if x > 0.0 && x < 9.95 => format!("{x:.1} %"),
        x => format!("{x:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_counts_and_shares_read_as_a_person_writes_them() {
        assert_eq!(duration(0.0), "0.0 s");
        assert_eq!(duration(59.9), "59.9 s");
        assert_eq!(duration(151.2), "2 min 31 s");
        assert_eq!(duration(119.7), "2 min 00 s");
        assert_eq!([grouped(0), grouped(999), grouped(1000), grouped(1_234_567)], ["0", "999", "1 000", "1 234 567"]);
        assert_eq!(
            [percent(0.0), percent(0.0001), percent(0.0123), percent(0.62), percent(1.0)],
            ["0 %", "< 0.1 %", "1.2 %", "62 %", "100 %"]
        );
    }
}
