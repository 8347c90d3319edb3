//! The gap as the head sees it: voltages from open circuit to short, classes of pulses, requested feed.
//!
//! A quantity without meaning has no value: the voltage without pulses, shares without a sample, the open-circuit voltage before
//! a seek has measured it.

use crate::Failure;
use crate::head::{Head, at, state};
use crate::sdo::Address;
use serde::Serialize;

/// Qualities (2005h:3) of a voltage that means something: valid, at the end of the range, reversed.
pub const MEASURED: [i64; 3] = [1, 3, 4];
/// Whether the levels of pulses fit (2013h:16): do not fit.
const DO_NOT_FIT: i64 = 2;
/// What to do then.
const TEACH: &str = "The levels do not fit this generator: pulses that burned are uncertain, and arcs are not counted. Teach them: \
    write 1 to 2013h:1, erode, and apply with 2; or set gap.open_v, gap.spark_v, gap.arc_below_v and gap.short_v.";
/// Classes of pulses: shares in 200Fh:1 to 6, half percents.
const CLASSES: u16 = 0x200F;

/// A voltage to compare with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// Which.
    pub what: &'static str,
    /// V; nothing where it is not known.
    pub volts: Option<f64>,
    /// Where it is from.
    pub from: &'static str,
}

/// Share of a pulse class in all pulses of the last 0.2 s; of no pulse: in the milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Share {
    /// Which kind.
    pub what: String,
    /// None where there was no pulse.
    pub percent: Option<f64>,
}

/// The gap now.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// Node-ID.
    pub node: u8,
    /// State of the head, in words.
    pub state: String,
    /// Gap voltage after the filters, V.
    pub volts: Option<f64>,
    /// What that is worth, in words.
    pub quality: String,
    /// From open circuit to short.
    pub ladder: [Rung; 4],
    /// What the pulses were.
    pub shares: Vec<Share>,
    /// What is wrong with that, and what to do.
    pub levels: Option<&'static str>,
    /// There were pulses.
    pub pulses: bool,
    /// Velocity along the path that the gap requests, um/s; none while it is not used.
    pub feed_um_s: Option<f64>,
}

impl Gap {
    /// Reads the gap.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn look(head: &Head) -> Result<Gap, Failure> {
        let named = |address: Address, number: i64| {
            let names = head.sheet.get(address).map(|object| object.names()).unwrap_or_default();
            names.get(&number).cloned().unwrap_or_else(|| number.to_string())
        };
        let quality = head.whole(at::GAP_QUALITY)?;
        let volts = head.number(at::GAP)?;
        let open = Some(head.number(at::OPEN)?).filter(|volts| *volts > 0.0);
        let percent = head.setting("seek.threshold_percent")?;
        let seek = open.map(|open| open * percent / 100.0);
        let rung = |what, volts, from| Rung { what, volts, from };
        let ladder = [
            rung("open circuit", open, "2005h:6, measured at the start of the seek"),
            rung("seek ends", seek, "seek.threshold_percent of open circuit"),
            rung("set point", Some(head.number(at::SETPOINT)?), "2005h:5"),
            rung("short", Some(head.setting("gap.short_v")?), "gap.short_v"),
        ];
        let mut counts = Vec::new();
        for object in head.sheet.objects().filter(|object| object.address.0 == CLASSES && object.address.1 > 0) {
            let what = object.key.rsplit('.').next().unwrap_or_default().to_lowercase();
            counts.push((what, head.whole(object.address)? as u32));
        }
        let pulses = counts.iter().any(|(what, share)| !what.starts_with("no") && *share > 0);
        let share = |half_percents| pulses.then(|| f64::from(half_percents) * 0.5);
        let shares = counts.into_iter().map(|(what, count)| Share { what, percent: share(count) }).collect();
        // A head of 0.2.0 has no such object.
        let levels = head.whole(at::LEVELS).is_ok_and(|fit| fit == DO_NOT_FIT).then_some(TEACH);
        let now = head.whole(at::STATE)?;
        let feed_um_s = if state::LED.contains(&(now as u8)) { Some(head.number(at::FEED)?) } else { None };
        Ok(Gap {
            node: head.node,
            state: named(at::STATE, now),
            volts: MEASURED.contains(&quality).then_some(volts),
            quality: named(at::GAP_QUALITY, quality),
            ladder,
            shares,
            levels,
            pulses,
            feed_um_s,
        })
    }

    /// In one line.
    pub fn text(&self) -> String {
        let said = |volts: Option<f64>| volts.map_or("-".into(), |volts| format!("{volts:.1} V"));
        let ladder: Vec<String> =
            self.ladder.iter().map(|rung| format!("{} {}", rung.what, said(rung.volts))).collect();
        let shares: Vec<String> = self
            .shares
            .iter()
            .map(|share| {
                format!("{} {}", share.what, share.percent.map_or("-".into(), |percent| format!("{percent:.0} %")))
            })
            .collect();
        format!(
            "{:16} gap {:>8} ({}); {}; {}; feed {}{}\n",
            self.state,
            said(self.volts),
            self.quality,
            ladder.join(", "),
            shares.join(", "),
            self.feed_um_s.map_or("-".into(), |feed| format!("{feed:.0} um/s")),
            self.levels.map_or(String::new(), |levels| format!("\n{levels}"))
        )
    }
}
