//! The heads on the bus.

use super::Plant;
use super::head::Head;
use crate::events::{EventError, Wires};
use crate::process::Process;
use crate::run::Setup;
use crate::scenario::{from_word, hint};
use crate::store::Store;
use edm_bus::Frame;
use edm_servo_head::canopen::NodeId;
use edm_servo_head::settings::Declared;
use std::path::Path;

/// Node-ID of heads that are to wait for one (CiA 305).
pub const UNCONFIGURED: u8 = 255;

/// Heads that have begun with rising node-IDs, or without any.
pub struct Fleet {
    heads: Vec<Head>,
    /// What the heads sent in the last tick, and which of them.
    sent: Vec<(usize, Frame)>,
    sending: Vec<Frame>,
    /// The last head is a coarse axis that carries the others.
    carries: bool,
}

/// A coarse axis: a head with a long stroke and no work near.
const COARSE: [&str; 6] = [
    "model.cable_n_mm=0",
    "model.stroke_mm=300",
    "axis.stroke_um=300000",
    "workpiece.surface_mm=299",
    "limit.lower_mm=298",
    "inch.step_um=0",
];

impl Fleet {
    /// Heads that have just been switched on: `count` of them from node-ID `first` on, or all [`UNCONFIGURED`], each with the
    /// next seed and serial number. A node-ID that is stored comes before that.
    ///
    /// # Errors
    /// When the values do not fit together, or the folder of their stores cannot be made.
    pub fn new(setup: &Setup, first: u8, count: u8, seed: u64, store: Option<&Path>) -> Result<Fleet, String> {
        let head = |index: u8| {
            let node = NodeId::new(first).and_then(|_| NodeId::new(first.checked_add(index)?));
            let (name, serial) = match node {
                Some(id) => (format!("node-{}", id.get()), id.get()),
                None => (format!("head-{}", index + 1), index + 1),
            };
            Head::new(setup, (node, serial.into()), seed.wrapping_add(index.into()), Store::new(store, &name)?)
        };
        let heads = (0..count).map(head).collect::<Result<_, String>>()?;
        Ok(Fleet { heads, sent: Vec::new(), sending: Vec::new(), carries: false })
    }

    /// The same with one node more, which stands for a coarse axis of the machine: where it is, it has carried the heads.
    ///
    /// # Errors
    /// When the folder of its store cannot be made.
    pub fn carried(mut self, id: NodeId, seed: u64, store: Option<&Path>) -> Result<Fleet, String> {
        let mut setup = Setup::load("default")?;
        for assignment in COARSE {
            setup.set(assignment)?;
        }
        let store = Store::new(store, &format!("node-{}", id.get()))?;
        self.heads.push(Head::new(&setup, (Some(id), id.get().into()), seed, store)?);
        self.carries = true;
        Ok(self)
    }
}

impl Plant for Fleet {
    fn tick(&mut self, came: &[Frame], sent: &mut Vec<Frame>) -> Result<(), String> {
        let before = std::mem::take(&mut self.sent);
        for (at, head) in self.heads.iter_mut().enumerate() {
            let others = before.iter().filter(|(sender, _)| *sender != at).map(|(_, frame)| frame);
            head.tick(came.iter().chain(others), &mut self.sending);
            self.sent.extend(self.sending.iter().map(|frame| (at, *frame)));
            sent.append(&mut self.sending);
        }
        if let (true, [heads @ .., axis]) = (self.carries, &mut self.heads[..]) {
            let mm = axis.process.truth().position_um * 1e-3;
            heads.iter_mut().for_each(|head| head.process.fault_inputs.carried_mm = mm);
        }
        Ok(())
    }

    fn line(&mut self, line: &str) -> Result<(), String> {
        let (node, rest) = match line.split_once(' ') {
            Some((word, rest)) if word.bytes().all(|byte| byte.is_ascii_digit()) => (Some(word), rest.trim()),
            _ => (None, line),
        };
        if line.is_empty() {
            return Ok(());
        }
        let meant = |head: &Head| node.is_none_or(|node| head.node_id().is_some_and(|id| node.parse() == Ok(id.get())));
        if let (Some(node), false) = (node, self.heads.iter().any(meant)) {
            return Err(format!("{node}: no such node on this bus"));
        }
        if let Some(seconds) = rest.strip_prefix("power.cut=") {
            return self.cut_power(seconds, meant);
        }
        let heads = self.heads.iter_mut().filter(|head| meant(head));
        pull(rest, heads.map(|head| &mut head.process))
    }
}

impl Fleet {
    /// The power of some heads is cut for so many seconds.
    fn cut_power(&mut self, seconds: &str, meant: impl Fn(&Head) -> bool) -> Result<(), String> {
        let seconds = seconds.parse().ok().filter(|seconds| (0.0..=60.0).contains(seconds));
        let seconds = seconds.ok_or("power.cut must be 0 to 60 s")?;
        for head in std::mem::take(&mut self.heads) {
            let head = if meant(&head) { head.cut_power(seconds).map_err(|error| error.to_string())? } else { head };
            self.heads.push(head);
        }
        Ok(())
    }
}

/// Breaks or repairs a wire of some machines: `SIGNAL=VALUE`.
///
/// # Errors
/// What is wrong with it; nothing has happened then.
pub fn pull<'a>(text: &str, machines: impl Iterator<Item = &'a mut Process>) -> Result<(), String> {
    let Some((key, word)) = text.split_once('=').map(|(key, word)| (key.trim(), word.trim())) else {
        return Err(format!("{text}: must be [NODE] SIGNAL=VALUE"));
    };
    let keys: Vec<&str> = Wires::FIELDS.iter().map(|field| field.key).collect();
    let unknown = || format!("{key}: no such signal{}; `edm-sim settings` lists all", hint(key, &keys));
    let field = Wires::FIELDS.iter().find(|field| field.key == key).ok_or_else(unknown)?;
    let refused = || format!("{key} = {word}: must be {}", field.allowed());
    let value = from_word(field, word).ok_or_else(refused)?;
    for process in machines {
        process.happen(key, value).map_err(|error| match error {
            EventError::Signal => unknown(),
            EventError::Time | EventError::Value(_) => refused(),
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use edm_servo_head::canopen::drive::DEVICE;
    use edm_servo_head::head::{Fault, State};
    use embedded_can::{Frame as _, StandardId};

    fn fleet(first: u8, count: u8) -> Fleet {
        Fleet::new(&Setup::load("default").unwrap(), first, count, 1, None).unwrap()
    }

    fn frame(id: u16, data: &[u8]) -> Frame {
        Frame::new(StandardId::new(id).unwrap(), data).unwrap()
    }

    /// What is sent within so many milliseconds after these frames have come.
    fn sent(fleet: &mut Fleet, came: &[Frame], ms: usize) -> Vec<Frame> {
        let mut sent = Vec::new();
        fleet.tick(came, &mut sent).unwrap();
        for _ in 0..20 * ms {
            fleet.tick(&[], &mut sent).unwrap();
        }
        sent
    }

    #[test]
    fn every_head_boots_as_its_own_node() {
        assert_eq!(sent(&mut fleet(126, 2), &[], 10)[..2], [frame(0x77E, &[0]), frame(0x77F, &[0])]);
        assert_eq!(sent(&mut fleet(1, 0), &[], 10), []);
    }

    /// What a head answers to a layer setting service.
    fn lss(fleet: &mut Fleet, data: [u8; 8]) -> Vec<Vec<u8>> {
        let answer = embedded_can::Id::Standard(StandardId::new(0x7E4).unwrap());
        let frames = sent(fleet, &[frame(0x7E5, &data)], 5).into_iter().filter(|frame| frame.id() == answer);
        frames.map(|frame| frame.data().to_vec()).collect()
    }

    /// Names the head with this serial number.
    fn name(fleet: &mut Fleet, serial: u8, id: u8) {
        let identity = [DEVICE.vendor, DEVICE.product, DEVICE.revision, serial.into()];
        for (command, word) in (0x40..).zip(identity) {
            let [a, b, c, d] = word.to_le_bytes();
            lss(fleet, [command, a, b, c, d, 0, 0, 0]);
        }
        assert_eq!(lss(fleet, [0x11, id, 0, 0, 0, 0, 0, 0]), [[0x11, 0, 0, 0, 0, 0, 0, 0]]);
    }

    #[test]
    fn heads_without_a_node_id_are_named_and_stay_so_if_that_was_stored() {
        let folder = tempfile::tempdir().unwrap();
        let new = || Fleet::new(&Setup::load("default").unwrap(), UNCONFIGURED, 3, 1, Some(folder.path())).unwrap();
        let mut fleet = new();
        assert_eq!(sent(&mut fleet, &[], 100), []);
        assert_eq!(lss(&mut fleet, [0x4C, 0, 0, 0, 0, 0, 0, 0]).len(), 3);
        for serial in [1, 2, 3] {
            name(&mut fleet, serial, 40 + serial);
            if serial < 3 {
                assert_eq!(lss(&mut fleet, [0x17, 0, 0, 0, 0, 0, 0, 0]), [[0x17, 0, 0, 0, 0, 0, 0, 0]]);
            }
            let booted = sent(&mut fleet, &[frame(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0])], 100);
            assert!(booted.contains(&frame(0x700 | u16::from(40 + serial), &[0])), "{booted:?}");
        }
        let ids = |fleet: &Fleet| fleet.heads.iter().map(|head| head.node_id().map(NodeId::get)).collect::<Vec<_>>();
        assert_eq!(ids(&fleet), [Some(41), Some(42), Some(43)]);
        // A power cycle, and another name.
        fleet = new();
        sent(&mut fleet, &[], 100);
        assert_eq!(ids(&fleet), [Some(41), Some(42), None]);
        name(&mut fleet, 2, 7);
        lss(&mut fleet, [0x17, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(ids(&fleet)[1], Some(42), "until it is reset");
        let booted = sent(&mut fleet, &[frame(0, &[130, 42])], 100);
        assert!(booted.contains(&frame(0x707, &[0])), "{booted:?}");
    }

    #[test]
    fn a_head_that_is_enabled_stores_no_name_and_gives_up_its_work_when_the_bit_rate_changes() {
        let mut fleet = fleet(1, 1);
        sent(&mut fleet, &[], 100);
        enabled(&mut fleet);
        name(&mut fleet, 1, 9);
        assert_eq!(lss(&mut fleet, [0x17, 0, 0, 0, 0, 0, 0, 0]), [[0x17, 255, 1, 0, 0, 0, 0, 0]]);
        assert_eq!(lss(&mut fleet, [0x13, 0, 2, 0, 0, 0, 0, 0]).len(), 1);
        assert_eq!(fleet.heads[0].status().state, State::Ready);
        assert_eq!(lss(&mut fleet, [0x15, 20, 0, 0, 0, 0, 0, 0]), [] as [Vec<u8>; 0]);
        assert_eq!(fleet.heads[0].status().fault, Some(Fault::HostSilent));
        let booted = sent(&mut fleet, &[], 100);
        assert_eq!(fleet.heads[0].bit_rate(), 500_000);
        assert!(booted.contains(&frame(0x709, &[0])), "{booted:?}");
    }

    #[test]
    fn a_name_and_settings_can_be_stored_at_the_same_moment() {
        let mut fleet = fleet(1, 1);
        sent(&mut fleet, &[], 100);
        name(&mut fleet, 1, 9);
        let both = [frame(0x601, b"\x23\x10\x10\x01save"), frame(0x7E5, &[0x17, 0, 0, 0, 0, 0, 0, 0])];
        let answers = sent(&mut fleet, &both, 100);
        assert!(answers.contains(&frame(0x581, &[0x60, 0x10, 0x10, 1, 0, 0, 0, 0])), "{answers:?}");
        assert!(answers.contains(&frame(0x7E4, &[0x17, 0, 0, 0, 0, 0, 0, 0])), "{answers:?}");
    }

    #[test]
    fn an_sdo_is_answered_in_the_tick_that_takes_it() {
        let mut fleet = fleet(5, 1);
        sent(&mut fleet, &[], 10);
        let mut answers = Vec::new();
        fleet.tick(&[frame(0x605, &[0x40, 0x18, 0x10, 0, 0, 0, 0, 0])], &mut answers).unwrap();
        assert_eq!(answers, [frame(0x585, &[0x4F, 0x18, 0x10, 0, 4, 0, 0, 0])]);
    }

    #[test]
    fn heads_hear_each_other() {
        let mut fleet = fleet(5, 2);
        sent(&mut fleet, &[], 10);
        // Node 6 watches node 5's heartbeat (1016h), which is switched off after a while: an emergency of node 6.
        let watch = frame(0x606, &[0x23, 0x16, 0x10, 1, 0x64, 0, 5, 0]);
        let beat = |ms: u8| frame(0x605, &[0x2B, 0x17, 0x10, 0, ms, 0, 0, 0]);
        sent(&mut fleet, &[watch, beat(20)], 5);
        let silent_for = |frames: &[Frame]| !frames.iter().any(|f| f.id() == StandardId::new(0x86).unwrap().into());
        assert!(silent_for(&sent(&mut fleet, &[], 300)));
        assert!(!silent_for(&sent(&mut fleet, &[beat(0)], 300)));
    }

    #[test]
    fn frames_that_mean_nothing_to_a_node_do_nothing() {
        let mut fleet = fleet(1, 1);
        sent(&mut fleet, &[], 10);
        let long =
            Frame::new(embedded_can::ExtendedId::new(0x601).unwrap(), &[0x40, 0x18, 0x10, 0, 0, 0, 0, 0]).unwrap();
        let remote = Frame::new_remote(StandardId::new(0x601).unwrap(), 8).unwrap();
        assert_eq!(sent(&mut fleet, &[long, remote], 5), []);
    }

    fn enabled(fleet: &mut Fleet) {
        // Operational; cyclic synchronous position; TPDO 1 synchronous as well, RPDO 2 with every SYNC.
        let write = |index: u16, sub: u8, size: u8, value: u32| {
            let [a, b] = index.to_le_bytes();
            let [v, w, x, y] = value.to_le_bytes();
            frame(0x601, &[0x23 | (4 - size) << 2, a, b, sub, v, w, x, y])
        };
        let setup = [
            write(0x1800, 2, 1, 1),
            write(0x1801, 2, 1, 1),
            write(0x1401, 2, 1, 1),
            write(0x60C2, 1, 1, 1),
            write(0x6060, 0, 1, 8),
            frame(0x000, &[1, 0]),
        ];
        for frame in setup {
            sent(fleet, &[frame], 2);
        }
        for word in [6, 7, 15] {
            sent(fleet, &[frame(0x201, &[word, 0])], 20);
        }
        assert_eq!(fleet.heads[0].status().state, State::Ready);
    }

    #[test]
    fn a_set_point_and_two_answers_every_millisecond_get_through_a_bus_that_is_95_percent_foreign() {
        let mut fleet = fleet(1, 1);
        sent(&mut fleet, &[], 100);
        enabled(&mut fleet);
        let mut foreign = edm_bus::filler::Frames::default();
        let (mut bits, mut answers, mut out) = (0.0, [0, 0], Vec::new());
        const MS: i32 = 1000;
        for ms in 0..MS {
            // A slow wave of 0.1 mm, down from where the head rests.
            let target = (50.0 - 50.0 * (f64::from(ms) * 0.0063).cos()) as i32;
            for tick in 0..20 {
                // 1 Mbit/s: 50 bits a tick.
                let mut came = Vec::new();
                while bits < f64::from(ms * 20 + tick + 1) * 50.0 * 0.95 {
                    came.extend(foreign.next().inspect(|frame| bits += f64::from(frame.bits())));
                }
                if tick == 7 {
                    came.push(frame(0x301, &target.to_le_bytes()));
                    came.push(frame(0x080, &[]));
                }
                fleet.tick(&came, &mut out).unwrap();
                if tick == 7 {
                    let sent = |id: u16| out.iter().any(|f: &Frame| f.id() == StandardId::new(id).unwrap().into());
                    answers[0] += i32::from(sent(0x181));
                    answers[1] += i32::from(sent(0x281));
                    out.clear();
                }
            }
            let status = fleet.heads[0].status();
            assert_eq!(status.state, State::Positioning, "{ms}");
            assert!((status.setpoint.to_f32() - target as f32).abs() < 3.0, "{ms}: {status:?}");
            assert!(status.following.abs() < 20.0, "{ms}: {status:?}");
        }
        assert_eq!(answers, [MS, MS], "both answers to every SYNC, in its own tick");
    }

    #[test]
    fn a_coarse_axis_is_the_last_node_and_carries_the_others() {
        let mut fleet = fleet(1, 2).carried(NodeId::new(3).unwrap(), 9, None).unwrap();
        let booted = sent(&mut fleet, &[], 10);
        assert_eq!(booted[..3], [frame(0x701, &[0]), frame(0x702, &[0]), frame(0x703, &[0])]);
        let surface = fleet.heads[0].process.truth().surface_um;
        fleet.line("3 hand.force_n=0.7").unwrap();
        sent(&mut fleet, &[], 50);
        let [one, two, axis] = [0, 1, 2].map(|at| fleet.heads[at].process.truth());
        assert!(axis.position_um > 300.0, "{axis:?}");
        for head in [one, two] {
            assert!((head.position_um - axis.position_um).abs() < 50.0, "{head:?}");
            assert_eq!(head.surface_um, surface);
            assert!((head.gap_um + head.face_um - surface).abs() < 50.0, "{head:?}");
        }
    }

    #[test]
    fn a_line_pulls_a_wire_at_every_head_or_at_one() {
        let mut fleet = fleet(5, 2);
        let open = |fleet: &mut Fleet| {
            sent(fleet, &[], 1);
            [0, 1].map(|at| fleet.heads[at].process.sensors().safety.lower_limit)
        };
        fleet.line("limit.lower_open=true").unwrap();
        assert_eq!(open(&mut fleet), [true, true]);
        fleet.line("5 limit.lower_open = false").unwrap();
        assert_eq!(open(&mut fleet), [false, true]);
        fleet.line("").unwrap();
    }

    #[test]
    fn a_line_that_means_nothing_is_refused_with_what_is_allowed() {
        let mut fleet = fleet(5, 2);
        for (line, message) in [
            ("limit.lower_open", "limit.lower_open: must be [NODE] SIGNAL=VALUE"),
            ("7 gap.short=true", "7: no such node on this bus"),
            ("300 gap.short=true", "300: no such node on this bus"),
            (
                "limit.lower=true",
                "limit.lower: no such signal, did you mean limit.lower_open?; `edm-sim settings` lists all",
            ),
            ("gap.short=yes", "gap.short = yes: must be true or false"),
            ("bus.sag_v=61", "bus.sag_v = 61: must be a number from 0 to 60 V"),
        ] {
            assert_eq!(fleet.line(line).unwrap_err(), message);
        }
    }
}
