//! The drive as a dictionary: what an object reads, and what a write does.

use super::state::State;
use super::{Drive, Order, TaskTimer, clamp32, codes, probe};
use crate::canopen::objects::{Decoded, Item, Row, entry, rows, setting_address, setting_address_at, setting_kind};
use crate::canopen::{Abort, DataType, Dictionary, Entry, Event, ObjectHandle, Request, Update, Written};
use crate::gap::pulses::Class;
use crate::gap::senses::delays::Delays;
use crate::head::{self, Carry, Command, Contradiction, Fault, Guidance, Inch};
use crate::path::{BESIDE_NM, Bound};
use crate::settings::{Change, Declared, Kind, SettingError, Settings, place};
use crate::units::{FRACTION_BITS, Volts};

/// Settings that the profile has its own objects for.
const FOLLOWING_WINDOW: u16 = place(Settings::KEYS, "supervise.following_um") as u16;
const FOLLOWING_TIME: u16 = place(Settings::KEYS, "supervise.following_ms") as u16;

impl Dictionary for Drive {
    fn entry(&self, index: u16, sub: u8) -> Result<Entry, Abort> {
        entry(index, sub)
    }

    fn read(&self, place: ObjectHandle, out: &mut [u8]) -> Result<usize, Abort> {
        match Decoded::at(place) {
            Decoded::Highest(sub) => copy(&[sub], out),
            Decoded::Setting(field) => self.read_setting(field, out),
            Decoded::Row(number) => {
                let row = rows().get(usize::from(number)).ok_or(Abort::NoObject)?;
                match row.item() {
                    Item::RefusedRule => copy(self.wrong.map_or("", |(_, _, rule)| rule).as_bytes(), out),
                    Item::BuildId => copy(self.identity.build.as_bytes(), out),
                    item => {
                        let bytes = self.number(item).to_le_bytes();
                        let size = row.kind().size().unwrap_or(0);
                        copy(bytes.get(..size).unwrap_or(&[]), out)
                    }
                }
            }
        }
    }

    fn write(&mut self, place: ObjectHandle, data: &[u8]) -> Result<Written, Abort> {
        match Decoded::at(place) {
            Decoded::Highest(_) => Err(Abort::ReadOnly),
            Decoded::Setting(field) => self.write_setting(field, data),
            Decoded::Row(number) => {
                let row = rows().get(usize::from(number)).ok_or(Abort::NoObject)?;
                let mut bytes = [0; 4];
                bytes.get_mut(..data.len()).ok_or(Abort::LengthTooHigh)?.copy_from_slice(data);
                let value = row.narrowed(u32::from_le_bytes(bytes));
                row.check(value)?;
                self.write_row(row.item(), value)
            }
        }
    }

    fn stream_length(&self, place: ObjectHandle) -> Result<u32, Abort> {
        match item_at(place) {
            Some(Item::DelaysTaken) => Ok(size_of::<Delays>() as u32),
            Some(item @ (Item::FastData | Item::SnapshotData)) => Ok(self.fast.length(item)),
            Some(Item::TuneData) => Ok(self.tuned.length()),
            _ => Ok(self.scope.length()),
        }
    }

    fn stream(&self, place: ObjectHandle, offset: u32, out: &mut [u8]) -> Result<(), Abort> {
        match item_at(place) {
            Some(Item::DelaysTaken) => {}
            Some(item @ (Item::FastData | Item::SnapshotData)) => {
                self.fast.copy(item, offset, out);
                return Ok(());
            }
            Some(Item::TuneData) => {
                self.tuned.copy(offset, out);
                return Ok(());
            }
            _ => {
                self.scope.copy(offset, out);
                return Ok(());
            }
        }
        for (byte, at) in out.iter_mut().zip(offset as usize..) {
            let bytes = self.delays.taken.get(at / 4).copied().unwrap_or(0).to_le_bytes();
            *byte = bytes.get(at % 4).copied().unwrap_or(0);
        }
        Ok(())
    }

    fn request(&mut self, request: Request) -> Result<(), Abort> {
        // Flash stalls the processor: only while nothing moves. A head that is about to disable gives the permit in
        // its turn, or does not.
        let closed =
            matches!(self.state, State::OperationEnabled | State::QuickStopActive | State::FaultReactionActive);
        if closed || self.enabling || self.fresh && self.status.state != head::State::Disabled {
            return Err(Abort::DeviceState);
        }
        // What wears the flash out.
        let wears = !matches!(request, Request::Update(Update::Stop | Update::Piece | Update::Last | Update::Start));
        if wears && !self.saves.take() {
            return Err(Abort::LocalControl);
        }
        let order = match request {
            Request::Store(group) => Order::Store(group),
            Request::Restore(group) => Order::Restore(group),
            Request::Update(update) => Order::Update(update),
        };
        if self.order(order) { Ok(()) } else { Err(Abort::DeviceState) }
    }

    fn event(&mut self, event: Event) {
        self.happened(event);
    }
}

impl Row {
    /// The bytes of a value as the number that they are.
    pub(super) fn narrowed(&self, raw: u32) -> i64 {
        match self.kind() {
            DataType::Integer8 => i64::from(raw as i8),
            DataType::Integer16 => i64::from(raw as i16),
            DataType::Integer32 => i64::from(raw.cast_signed()),
            _ => raw.into(),
        }
    }

    /// A kept value as the number that it is.
    fn widened(&self, kept: i32) -> i64 {
        match self.kind() {
            DataType::Unsigned32 => kept.cast_unsigned().into(),
            _ => kept.into(),
        }
    }
}

impl Drive {
    /// The number that an object reads.
    fn number(&self, item: Item) -> i64 {
        let status = &self.status;
        let axis = &self.active.head.axis;
        let centivolts = |volts: Volts| i64::from((volts.0 * 100.0) as i16);
        let [gap, servo, supervision, protocol, plan] = &self.timers;
        let last = |timer: &TaskTimer| i64::from(timer.last);
        let most = |timer: &TaskTimer| i64::from(timer.most);
        let load = |timer: &TaskTimer| i64::from(timer.load);
        // Below an axis of many counts to the millimetre: 10^6 nm over the nm of a count.
        match item {
            Item::HeadState => status.state as i64,
            Item::HeadFault => status.fault.map_or(0, Fault::number).into(),
            Item::HeadFirst => status.first.map_or(0, Fault::number).into(),
            Item::HeadReason => self.reason.into(),
            Item::HeadRefusal => self.refusal.into(),
            Item::HeadHomed => status.homed.into(),
            Item::Guidance => status.guidance as i64,
            Item::HomingError => self.homing_error().into(),
            Item::ServoTime => probe::time(status.tick).into(),
            Item::ProbeStatus => self.probe_status().into(),
            Item::ProbeBegun1 => self.host_position(self.probe_edge(0, 0).position).into(),
            Item::ProbeEnded1 => self.host_position(self.probe_edge(0, 1).position).into(),
            Item::ProbeBegun2 => self.host_position(self.probe_edge(1, 0).position).into(),
            Item::ProbeEnded2 => self.host_position(self.probe_edge(1, 1).position).into(),
            Item::ProbeTimeBegun1 => probe::time(self.probe_edge(0, 0).tick).into(),
            Item::ProbeTimeEnded1 => probe::time(self.probe_edge(0, 1).tick).into(),
            Item::ProbeTimeBegun2 => probe::time(self.probe_edge(1, 0).tick).into(),
            Item::ProbeTimeEnded2 => probe::time(self.probe_edge(1, 1).tick).into(),
            Item::ProbeCountBegun1 => self.probe_edge(0, 0).count.into(),
            Item::ProbeCountEnded1 => self.probe_edge(0, 1).count.into(),
            Item::ProbeCountBegun2 => self.probe_edge(1, 0).count.into(),
            Item::ProbeCountEnded2 => self.probe_edge(1, 1).count.into(),
            Item::Refusals => self.refusals.into(),
            Item::AdaptiveFeed => self.adaptive_feed(),
            Item::LateSetPoints => status.late_set_points.into(),
            Item::CheckResult => self.finding.into(),
            Item::RefusedSetting => number_of(self.wrong.map(|(index, sub, _)| (index, sub))),
            Item::RefusedMeasured => self.contradiction.measured.into(),
            Item::RefusedLeast => self.contradiction.least.into(),
            Item::RefusedMost => self.contradiction.most.into(),
            Item::StoppedBy => self.stopped_by.into(),
            Item::QueueSpace => self.queue_space().into(),
            Item::QueueSegment => self.appended.saturating_sub(status.waiting.into()).into(),
            Item::SegmentRefused => self.segment.refused.into(),
            Item::SegmentsAppended => self.appended.into(),
            Item::RetreatBound => match status.retreat_ended {
                Some(Bound::Memory) => 1,
                Some(Bound::Distance) => 2,
                Some(Bound::Mark) => 3,
                _ => 0,
            },
            Item::SetpointX | Item::SetpointY => {
                let [x, y] = status.beside;
                let um = if item == Item::SetpointX { x } else { y };
                let nm = um.0.saturating_mul(BESIDE_NM).saturating_add(1 << (FRACTION_BITS - 1)) >> FRACTION_BITS;
                clamp32(nm).into()
            }
            Item::PathCoordinate => clamp32(status.path.round()).into(),
            Item::PathFeed => i64::from(status.feed.0 as i32),
            Item::GapVoltage => centivolts(status.gap.filtered),
            Item::GapBlock => centivolts(status.gap.mean),
            Item::GapQuality => status.gap.quality as i64,
            Item::GapShort => status.gap.short_ticks.min(u16::MAX.into()).into(),
            Item::GapSetpoint => centivolts(status.gap_setpoint),
            Item::GapOpen => centivolts(status.open_circuit),
            Item::Duty => i64::from((status.duty * 10_000.0) as i16),
            Item::Current => i64::from((status.current.0 * 1000.0) as i16),
            Item::RatedCurrent => i64::from((axis.current.continuous.0 * 1000.0) as u32),
            // The force of a voice coil is proportional to its current.
            Item::TorqueActual | Item::CurrentActual => {
                i64::from((status.current.0 / axis.current.continuous.0 * 1000.0) as i16)
            }
            Item::Saturated => status.saturated.into(),
            Item::CurrentReduced => status.current_reduced.into(),
            Item::Illegal => status.illegal_transitions.into(),
            Item::EmfDifference => i64::from(status.back_emf.difference().0 as i32),
            Item::ResetCause => self.identity.reset_cause.into(),
            Item::SelfTest => self.identity.self_test.bits().into(),
            Item::LastEnd => self.identity.last_end.into(),
            Item::GapLast => last(gap),
            Item::GapMost => most(gap),
            Item::GapLoad => load(gap),
            Item::ServoLast => last(servo),
            Item::ServoMost => most(servo),
            Item::ServoLoad => load(servo),
            Item::SupervisionLast => last(supervision),
            Item::SupervisionMost => most(supervision),
            Item::SupervisionLoad => load(supervision),
            Item::ProtocolLast => last(protocol),
            Item::ProtocolMost => most(protocol),
            Item::ProtocolLoad => load(protocol),
            Item::PlanLast => last(plan),
            Item::PlanMost => most(plan),
            Item::PlanLoad => load(plan),
            Item::StoredOutcome => self.loaded().outcome as i64,
            Item::StoredSkipped => self.loaded().skipped.count.into(),
            Item::StoredSkippedFirst => number_of(self.loaded().skipped.first),
            Item::StoredDefaulted => self.loaded().defaulted.count.into(),
            Item::StoredDefaultedFirst => number_of(self.loaded().defaulted.first),
            Item::GenerationNewest => self.generations.newest.into(),
            Item::GenerationServo => self.generations.servo.into(),
            Item::GenerationGap => self.generations.gap.into(),
            Item::GenerationSupervision => self.generations.supervision.into(),
            Item::Touched => self.host_position(status.touched).into(),
            Item::SearchOutcome => status.search as i64,
            Item::SearchOvershoot => status.overshoot.into(),
            Item::DatumOffset | Item::Wear | Item::Travel | Item::HoleDepth | Item::KeptSurface => {
                self.datum_number(item)
            }
            Item::KeptState
            | Item::GoOnRefused
            | Item::KeptDepth
            | Item::KeptTarget
            | Item::KeptPath
            | Item::KeptRow
            | Item::KeptHome
            | Item::KeptHeadState
            | Item::WorkOn
            | Item::WorkEroding
            | Item::WorkPulses
            | Item::WorkArcs
            | Item::WorkShorts
            | Item::WorkHoles => self.resume_number(item),
            Item::TechnologyRows
            | Item::TechnologyUse
            | Item::TechnologyWhy
            | Item::TechnologyWrongRow
            | Item::TechnologyRow
            | Item::TechnologyState
            | Item::PulseOnTime
            | Item::PulseOffTime
            | Item::PulseCurrent
            | Item::PulsePolarity => self.technology_number(item),
            Item::InchState => status.inch as i64,
            Item::InchAsks => (status.inch == Inch::Asks).into(),
            Item::CarryTo => clamp32(status.carry_to).into(),
            Item::CoarsePlace => clamp32(status.coarse).into(),
            Item::Carried => clamp32(status.carried).into(),
            Item::Inches => status.inches.into(),
            Item::InchError => clamp32(status.inch_error).into(),
            Item::Deepest => self.host_position(self.value(Item::Deepest).into()).into(),
            Item::GuardedChange => self.guarded.into(),
            Item::LostFrames => self.lost.frames.into(),
            Item::LostEvents => self.lost.events.into(),
            Item::LostTicks => self.lost.ticks.into(),
            Item::LostBlocks => self.lost.blocks.into(),
            Item::UnseenHigh => self.lost.unseen[0].into(),
            Item::UnseenLow => self.lost.unseen[1].into(),
            Item::GateRings => self.lost.rings.into(),
            Item::PulsesOpen => self.looks[Class::Open as usize].into(),
            Item::PulsesSpark => self.looks[Class::Spark as usize].into(),
            Item::PulsesArc => self.looks[Class::Arc as usize].into(),
            Item::PulsesShort => self.looks[Class::Short as usize].into(),
            Item::PulsesNone => self.looks[Class::NoPulse as usize].into(),
            Item::PulsesUncertain => self.looks[Class::Uncertain as usize].into(),
            Item::GapError => centivolts(status.gap_error),
            Item::HazardRate => status.senses.hazard.map_or(0, |hazard| i64::from(hazard.rate as u32)),
            Item::HazardDeviation => {
                status.senses.hazard.map_or(0, |hazard| i64::from((1000.0 * libm::sqrtf(hazard.variance)) as u16))
            }
            Item::GapByCharging => {
                status.senses.distance.map_or(0, |charged| i64::from((100.0 * charged.gap.0) as u16))
            }
            Item::ChargingInside => status.senses.distance.map_or(0, |charged| if charged.inside { 1 } else { 2 }),
            Item::SparkRate => status.senses.frequency.map_or(0, |rate| i64::from(rate as u32)),
            Item::SparksMissing => match status.senses.frequency {
                Some(_) => status.senses.missing.into(),
                None => 2,
            },
            Item::PulseAge => status.senses.age.into(),
            Item::MainsFrequency => self.mains.0.into(),
            Item::MainsLocked => self.mains.1.into(),
            Item::CountOpen => status.gap.pulses.class(Class::Open).into(),
            Item::CountSpark => status.gap.pulses.class(Class::Spark).into(),
            Item::CountArc => status.gap.pulses.class(Class::Arc).into(),
            Item::CountShort => status.gap.pulses.class(Class::Short).into(),
            Item::CountUncertain => status.gap.pulses.class(Class::Uncertain).into(),
            Item::Pauses => self.pauses.into(),
            Item::StepCount => self.steps.counted.cast_signed().into(),
            Item::StepRate => self.steps.rate.into(),
            Item::StepTurns => self.steps.turns.into(),
            Item::StepsLost => self.steps.lost.into(),
            Item::StepsTaken => status.takes_steps.into(),
            Item::StepsUnfollowed => status.unfollowed as i64,
            Item::IdentifyStep
            | Item::IdentifyWhy
            | Item::FoundResistance
            | Item::FoundResistanceOff
            | Item::FoundInductance
            | Item::FoundInductanceOff
            | Item::FoundConstant
            | Item::FoundConstantOff
            | Item::FoundMass
            | Item::FoundMassOff
            | Item::FoundBreakaway
            | Item::FoundBreakawayOff
            | Item::FoundSliding
            | Item::FoundSlidingOff
            | Item::FoundCounterbalance
            | Item::FoundCounterbalanceOff => self.found.number(item, self.status.stage),
            Item::TuneStep | Item::TuneWhy | Item::TunePoints => self.tuned.number(item, self.status.tunes),
            Item::TeachStep
            | Item::TeachWhy
            | Item::TeachPulses
            | Item::TeachNeeded
            | Item::TeachTime
            | Item::TeachContact
            | Item::TeachContactVoltage
            | Item::TaughtOpen
            | Item::TaughtSpark
            | Item::TaughtArc
            | Item::TaughtShort
            | Item::TaughtNoise
            | Item::TaughtApart
            | Item::LevelsFit
            | Item::ArcsUndelayed
            | Item::ArcsUndelayedError => self.teach.number(item),
            Item::ScopeState => self.scope.phase() as i64,
            Item::ScopeCount => self.scope.count().into(),
            Item::FastState => self.fast.phase().into(),
            Item::Snapshots => self.fast.snapshots().into(),
            Item::ErrorCode => match self.state {
                State::Fault | State::FaultReactionActive => {
                    self.alarm.map_or(0, |fault| codes::error_code(fault).0).into()
                }
                _ => 0,
            },
            Item::Controlword => self.control.into(),
            Item::Statusword => self.status_bits().into(),
            Item::ModeDisplay => self.mode_number(),
            Item::PositionDemand => self.host_position(status.setpoint.round()).into(),
            Item::DemandInternal => clamp32(status.setpoint.round()).into(),
            Item::PositionActual => self.position().into(),
            Item::PositionInternal => clamp32(status.position).into(),
            Item::FollowingWindow => i64::from((self.settings.following_limit * axis.counts_per_um) as u32),
            Item::FollowingTime => self.settings.following_ms.into(),
            Item::VelocityDemand => i64::from((status.feed.0 * axis.counts_per_um) as i32),
            Item::VelocityActual => i64::from(self.pace.velocity().0 as i32),
            Item::BusVoltage => i64::from((status.bus.0 * 1000.0) as u32),
            Item::MaxVelocity => i64::from(axis.gains.velocity_limit().0 as u32),
            Item::EncoderRevolutions | Item::FeedRevolutions => axis.nm_per_count,
            Item::IpPosition => self.set_points.waiting().into(),
            Item::FollowingError => i64::from(status.following as i32),
            Item::PhysicalOutputs => {
                i64::from(status.state.pulses()) << 16
                    | i64::from(status.closed) << 17
                    | i64::from(status.inch == Inch::Asks) << 18
                    | i64::from(status.takes_steps) << 19
            }
            Item::DigitalInputs => {
                let safety = &status.safety;
                i64::from(safety.upper_limit)
                    | i64::from(safety.lower_limit) << 1
                    | i64::from(safety.emergency_stop) << 16
                    | i64::from(safety.dielectric) << 17
                    | i64::from(safety.bridge_fault) << 18
                    | i64::from(safety.supply_low) << 19
                    | i64::from(self.touches()) << 20
            }
            item => rows().get(item as usize).map_or(0, |row| row.widened(self.value(item))),
        }
    }

    /// A value within its range has come.
    fn write_row(&mut self, item: Item, value: i64) -> Result<Written, Abort> {
        let done = |taken: bool| if taken { Ok(Written::Now) } else { Err(Abort::DeviceState) };
        let number = value as i32;
        let before = self.value(item);
        self.permits(item, value)?;
        match item {
            Item::Controlword => self.control_word(value as u16),
            Item::Mode => self.set_mode(value)?,
            Item::ErodeEnable => self.may_erode(value)?,
            Item::TargetPosition => self.target_written(number)?,
            Item::PathPlace => self.place_written(number),
            Item::IpData => self.data_written(number)?,
            Item::IpClear if value == 0 => self.clear_buffer(),
            Item::FollowingWindow => {
                let um = value as f32 / self.active.head.axis.counts_per_um;
                return self.write_word(FOLLOWING_WINDOW, um.to_bits());
            }
            Item::FollowingTime => {
                return self.write_word(FOLLOWING_TIME, value as u32);
            }
            Item::ProbeFunction => self.probe_function(value as u16)?,
            Item::ProbeSource1 => self.may_choose(0)?,
            Item::ProbeSource2 => self.may_choose(1)?,
            Item::ErodeHold if value == 1 => self.hold_all(),
            Item::Jump if value == 1 => {
                let erodes = self.status.state == head::State::Eroding || !self.fresh;
                return done(erodes && self.command(Command::Jump));
            }
            Item::SearchStart if value == 1 => {
                let reach = self.nanometres(self.value(Item::SearchReach));
                return done(self.may_search() && self.command(Command::FindSurface(reach)));
            }
            Item::SurfaceIs => return done(self.take_surface(value)),
            Item::KeptSurface => self.keep_surface(number),
            Item::GoOn => return done(self.go_on(value)),
            Item::KeptRow => return done(self.resume.row(value as u16)),
            Item::TechnologyUse
            | Item::TechnologyRow
            | Item::RowBegin
            | Item::RowLeaves
            | Item::RowOnTime
            | Item::RowOffTime
            | Item::RowCurrent
            | Item::RowPolarity
            | Item::RowSetting
            | Item::RowValue => return self.technology_written(item, value),
            Item::CoarsePlace => {
                let carry = Carry::To(self.nanometres(number));
                return done(self.may_carry() && self.command(Command::Carry(carry)));
            }
            Item::CarryAnswer if value != 0 && number != before => {
                let carry = if value == 1 { Carry::AsAsked } else { Carry::Refused };
                if !(self.is_inching() && self.command(Command::Carry(carry))) {
                    return Err(Abort::DeviceState);
                }
            }
            // Its answer to the question before.
            Item::CarryAnswer if value != 0 && self.status.inch == Inch::Asks => return Err(Abort::DeviceState),
            Item::TargetVelocity => self.may_run(number != before)?,
            Item::Commission if value == 1 => return done(self.commission()),
            Item::Commission => self.end_commissioning(),
            Item::QueueAppend => {
                return done(self.queues() && self.command(Command::MoveTo(self.place(number))));
            }
            Item::QueueAppendBy => {
                return done(self.queues() && self.command(Command::MoveBy(self.nanometres(number))));
            }
            Item::SegmentCommit if value == 1 => return done(self.commit_segment()),
            Item::SegmentCommit => self.segment.forget(),
            Item::QueueClear if value == 1 => {
                let free = !self.status.state.works() && !self.is_positioned();
                return done(free && self.acts() && self.command(Command::ClearPath));
            }
            Item::ScopeSignal1 | Item::ScopeSignal2 | Item::ScopeSignal3 | Item::ScopeSignal4 if value != 0 => {
                signal_entry(value as u32)?;
            }
            Item::DelaysTake => self.delays.take(),
            Item::TeachIn => return self.teach(value),
            Item::Identify => return self.identify(value),
            Item::Tune => return self.tune(value),
            Item::ScopeArm if value == 1 => self.scope.arm(),
            Item::ScopeArm => self.scope.stop(),
            Item::FastArm => self.arm_fast(value == 1)?,
            _ => {}
        }
        self.set(item, number);
        self.segment.written(item);
        match item {
            Item::TargetVelocity => self.velocity_written(before),
            Item::PositionOffset if number != before => self.offset_written(),
            Item::TorqueOffset if number != before => self.push(),
            Item::ErodeEnable => self.erode_written(before),
            _ => {}
        }
        Ok(Written::Now)
    }

    /// The feed that the gap asks of a host that guides the head, per mille of the host's own.
    fn adaptive_feed(&self) -> i64 {
        let feed = self.status.feed.0;
        let own = match self.value(Item::HostFeed) {
            0 => self.active.head.limits.feed.0,
            own => own as f32,
        };
        match self.status.guidance {
            Guidance::No => 0,
            _ => i64::from((1000.0 * (feed / own)) as i16).clamp(-1000, 1000),
        }
    }

    /// Electrode and work touch, as the sense shows while the generator is off: between pulses there is no voltage either.
    pub(super) fn touches(&self) -> bool {
        let pulses = self.status.state.pulses() || self.status.state == head::State::Commissioning;
        self.status.gap.touches && !pulses
    }

    /// Whether a segment may be appended now.
    fn queues(&self) -> bool {
        self.acts() && self.queue_space() > 0 && self.status.homed && !self.is_positioned()
    }

    /// Set points of the axis, and not the path, lead the head.
    pub(super) fn is_positioned(&self) -> bool {
        self.fresh && (self.status.state.positions() || self.status.guidance != Guidance::No)
    }

    /// A signal of the scope: a value of up to 32 bits, sign extended.
    pub(super) fn signal(&self, address: u32) -> i32 {
        let Ok(entry) = signal_entry(address) else { return 0 };
        let mut bytes = [0; 8];
        if self.read(entry.place, &mut bytes).is_err() {
            return 0;
        }
        let [a, b, c, d, ..] = bytes;
        let raw = u32::from_le_bytes([a, b, c, d]);
        match entry.kind {
            DataType::Integer8 => (raw as i8).into(),
            DataType::Integer16 => (raw as i16).into(),
            _ => raw.cast_signed(),
        }
    }

    fn read_setting(&self, field: u16, out: &mut [u8]) -> Result<usize, Abort> {
        let word = self.settings.word(field.into()).ok_or(Abort::NoSubIndex)?.to_le_bytes();
        let size = setting_kind(field).and_then(|(kind, _)| kind.size()).ok_or(Abort::NoSubIndex)?;
        copy(word.get(..size).unwrap_or(&[]), out)
    }

    fn write_setting(&mut self, field: u16, data: &[u8]) -> Result<Written, Abort> {
        let mut word = [0; 4];
        word.get_mut(..data.len()).ok_or(Abort::Length)?.copy_from_slice(data);
        self.write_word(field, u32::from_le_bytes(word))
    }

    /// Sets a setting, if it can be with the others and in this state.
    fn write_word(&mut self, field: u16, word: u32) -> Result<Written, Abort> {
        self.write_words(&[(field, word)])
    }

    /// Sets settings, if they can be with the others and in this state: all or none.
    pub(super) fn write_words(&mut self, words: &[(u16, u32)]) -> Result<Written, Abort> {
        // Hosts write all settings of a file, few of which differ. Nothing is computed anew, and no task asked.
        let same = |&(field, word): &(u16, u32)| self.settings.word(field.into()) == Some(word);
        if !self.stale && !self.configuring && words.iter().all(same) {
            self.technology.keep(words);
            (self.wrong, self.contradiction) = (None, Contradiction::default());
            return Ok(Written::Now);
        }
        let mut pending = self.settings;
        for &(field, word) in words {
            pending.put_word(field.into(), word).map_err(|error| {
                let (index, sub) = setting_address_at(field.into()).unwrap_or((0, 0));
                if words.len() > 1 {
                    (self.wrong, self.contradiction) =
                        (Some((index, sub, "is out of its range")), Contradiction::default());
                }
                out_of_range(&error, word)
            })?;
        }
        let first = words.first().map_or(0, |(field, _)| *field);
        let wired = |settings: &Settings| (settings.gap_reversed, settings.motor_reversed, settings.encoder_reversed);
        let mut active = match pending.build() {
            Ok(active) => active,
            Err(error) => {
                let (address, rule) = match error {
                    SettingError::Conflict { field, rule } => (setting_address(field), rule),
                    _ => (setting_address_at(first.into()), "is out of its range"),
                };
                let (index, sub) = address.unwrap_or((0, 0));
                (self.wrong, self.contradiction) = (Some((index, sub, rule)), Contradiction::default());
                return Err(Abort::Incompatible);
            }
        };
        // The last of them that is guarded and changes.
        let mut guarded = None;
        for &(field, word) in words {
            let change = Settings::FIELDS.get(usize::from(field)).map(|field| (field.change, &field.kind));
            let (change, kind) = change.ok_or(Abort::NoSubIndex)?;
            let (index, sub) = setting_address_at(field.into()).unwrap_or((0, 0));
            if self.may_be_enabled() && !change.permits(kind, self.settings.word(field.into()).unwrap_or(word), word) {
                (self.wrong, self.contradiction) = (Some((index, sub, change.rule())), Contradiction::default());
                return Err(Abort::DeviceState);
            }
            if change != Change::Live {
                guarded = Some(u32::from(index) << 8 | u32::from(sub));
            }
        }
        if self.stale || self.configuring {
            return Err(Abort::DeviceState);
        }
        // Commissioning has to look again at what it has passed. More friction than it has found would hide a dead encoder.
        let stiffer = pending.axis_breakaway > self.settings.axis_breakaway;
        if stiffer || self.active.head.axis.plant != active.head.axis.plant || wired(&pending) != wired(&self.settings)
        {
            pending.commissioned = false;
            active.head.commissioned = false;
        }
        // One configuration at a time: this one can be taken back.
        if !self.configure() {
            return Err(Abort::DeviceState);
        }
        if let Some(address) = guarded {
            self.guarded = (self.guarded & !0xFF_FFFF).wrapping_add(1 << 24) | address;
        }
        self.technology.keep(words);
        self.settings = pending;
        self.active = active;
        (self.wrong, self.contradiction) = (None, Contradiction::default());
        Ok(Written::Later)
    }

    /// The head may be enabled, or about to be.
    fn may_be_enabled(&self) -> bool {
        self.status.state != head::State::Disabled || self.enabling || self.commissioning
    }
}

/// What is at a place, where that is a row.
fn item_at(place: ObjectHandle) -> Option<Item> {
    let Decoded::Row(number) = Decoded::at(place) else { return None };
    rows().get(usize::from(number)).map(Row::item)
}

/// An address as a number; 0 for none.
fn number_of(address: Option<(u16, u8)>) -> i64 {
    address.map_or(0, |(index, sub)| i64::from(index) << 8 | i64::from(sub))
}

fn out_of_range(error: &SettingError, word: u32) -> Abort {
    let SettingError::NotAllowed(field) = error else { return Abort::NoSubIndex };
    let number = f32::from_bits(word);
    match field.kind {
        Kind::Number { max, .. } if number > max => Abort::ValueTooHigh,
        Kind::Number { min, .. } if number < min => Abort::ValueTooLow,
        Kind::Number { .. } => Abort::InvalidValue,
        Kind::Integer { min, .. } if word < min => Abort::ValueTooLow,
        _ => Abort::ValueTooHigh,
    }
}

fn signal_entry(address: u32) -> Result<Entry, Abort> {
    let entry = entry((address >> 8) as u16, address as u8).map_err(|_| Abort::InvalidValue)?;
    let fits = entry.kind.size().is_some_and(|size| size <= 4) && entry.access.readable();
    if fits { Ok(entry) } else { Err(Abort::InvalidValue) }
}

fn copy(bytes: &[u8], out: &mut [u8]) -> Result<usize, Abort> {
    out.get_mut(..bytes.len()).ok_or(Abort::General)?.copy_from_slice(bytes);
    Ok(bytes.len())
}
