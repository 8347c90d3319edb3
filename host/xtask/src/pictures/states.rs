//! The states of the head and their changes: `edm_servo_head::head::TRANSITIONS`, which a test compares with what heads do.
//!
//! The places of boxes and arrows are given here. Arrows that are not those of the table are an error.

use super::svg::{Anchor, Fill, Sheet};
use edm_servo_head::head::State::{
    Commissioning, Disabled, Done, Eroding, Fault, Guiding, HoldingPosition, Homing, Identifying, Inching, Jumping,
    Lifting, Positioning, Proving, Ready, Retreating, Seeking, Touching,
};
use edm_servo_head::head::{Reason, State, TRANSITIONS};

/// Box of a state.
fn place(state: State) -> ((f64, f64), (f64, f64)) {
    match state {
        Disabled => ((40.0, 270.0), (120.0, 44.0)),
        Commissioning => ((40.0, 480.0), (130.0, 44.0)),
        Proving => ((250.0, 480.0), (110.0, 44.0)),
        Ready => ((305.0, 212.0), (140.0, 40.0)),
        HoldingPosition => ((305.0, 287.0), (140.0, 40.0)),
        Done => ((305.0, 362.0), (140.0, 40.0)),
        Positioning => ((240.0, 50.0), (120.0, 44.0)),
        Homing => ((440.0, 50.0), (110.0, 44.0)),
        Touching => ((40.0, 50.0), (120.0, 44.0)),
        Seeking => ((610.0, 200.0), (120.0, 44.0)),
        Eroding => ((610.0, 285.0), (120.0, 44.0)),
        Guiding => ((610.0, 380.0), (120.0, 44.0)),
        Retreating => ((810.0, 285.0), (120.0, 44.0)),
        Jumping => ((610.0, 64.0), (120.0, 44.0)),
        Inching => ((810.0, 64.0), (120.0, 44.0)),
        Lifting => ((440.0, 455.0), (110.0, 40.0)),
        Fault => ((610.0, 520.0), (120.0, 44.0)),
        Identifying => ((345.0, 596.0), (130.0, 40.0)),
    }
}

/// An arrow: from any of these states to this one, for any of these reasons; what is written on it, and where.
struct Arrow {
    from: &'static [State],
    to: State,
    reasons: &'static [Reason],
    points: &'static [(f64, f64)],
    label: &'static str,
    at: (f64, f64),
}

/// States at rest with the loop closed.
const REST: &[State] = &[Ready, HoldingPosition, Done];

/// How an erosion ends.
const ENDS: &[Reason] =
    &[Reason::PathEnd, Reason::PathStop, Reason::SparkedOut, Reason::SparkOutTime, Reason::BrokenThrough];

const fn arrow(
    from: &'static [State],
    to: State,
    reasons: &'static [Reason],
    points: &'static [(f64, f64)],
    label: &'static str,
    at: (f64, f64),
) -> Arrow {
    Arrow { from, to, reasons, points, label, at }
}

const ARROWS: &[Arrow] = &[
    arrow(&[Disabled], Ready, &[Reason::Enabled], &[(160.0, 285.0), (290.0, 285.0)], "enable", (180.0, 279.0)),
    arrow(
        &[Disabled],
        Proving,
        &[Reason::ProofStarted],
        &[(160.0, 302.0), (270.0, 302.0), (270.0, 480.0)],
        "encoder in doubt",
        (154.0, 340.0),
    ),
    arrow(
        &[Disabled],
        Commissioning,
        &[Reason::CommissioningStarted],
        &[(125.0, 314.0), (125.0, 480.0)],
        "commission",
        (131.0, 402.0),
    ),
    arrow(
        &[Commissioning],
        Disabled,
        &[Reason::CommissioningEnded],
        &[(70.0, 480.0), (70.0, 314.0)],
        "ended",
        (76.0, 402.0),
    ),
    arrow(&[Proving], Ready, &[Reason::Enabled], &[(335.0, 480.0), (335.0, 425.0)], "proved", (342.0, 458.0)),
    arrow(
        &[Proving],
        Commissioning,
        &[Reason::CommissioningStarted],
        &[(250.0, 502.0), (170.0, 502.0)],
        "proved",
        (188.0, 496.0),
    ),
    arrow(REST, Positioning, &[Reason::Positioned], &[(305.0, 175.0), (305.0, 94.0)], "move", (264.0, 140.0)),
    arrow(
        &[Positioning],
        Ready,
        &[Reason::Arrived, Reason::Touched, Reason::Held],
        &[(345.0, 94.0), (345.0, 175.0)],
        "at rest",
        (351.0, 140.0),
    ),
    arrow(
        REST,
        Touching,
        &[Reason::Positioned],
        &[(290.0, 194.0), (80.0, 194.0), (80.0, 94.0)],
        "touch",
        (87.0, 140.0),
    ),
    arrow(
        &[Touching],
        Ready,
        &[Reason::Touched, Reason::NotTouched],
        &[(130.0, 94.0), (130.0, 182.0), (290.0, 182.0)],
        "at rest",
        (137.0, 122.0),
    ),
    arrow(&[Touching], Positioning, &[Reason::Held], &[(160.0, 57.0), (240.0, 57.0)], "hold", (184.0, 51.0)),
    arrow(
        REST,
        Identifying,
        &[Reason::IdentificationStarted, Reason::TuningStarted],
        &[(392.0, 425.0), (392.0, 596.0)],
        "identify, tune",
        (318.0, 586.0),
    ),
    arrow(
        &[Identifying],
        Ready,
        &[Reason::Identified, Reason::Tuned],
        &[(424.0, 596.0), (424.0, 425.0)],
        "measured",
        (430.0, 586.0),
    ),
    arrow(
        &[Identifying],
        Positioning,
        &[Reason::Held],
        &[(345.0, 616.0), (195.0, 616.0), (195.0, 88.0), (240.0, 88.0)],
        "hold",
        (260.0, 610.0),
    ),
    arrow(REST, Homing, &[Reason::HomingStarted], &[(450.0, 175.0), (450.0, 94.0)], "home", (406.0, 140.0)),
    arrow(
        &[Homing],
        Ready,
        &[Reason::Homed, Reason::NotHomed],
        &[(475.0, 94.0), (475.0, 195.0), (460.0, 195.0)],
        "found or not",
        (481.0, 140.0),
    ),
    arrow(&[Positioning], Homing, &[Reason::HomingStarted], &[(360.0, 62.0), (440.0, 62.0)], "home", (384.0, 57.0)),
    arrow(&[Homing], Positioning, &[Reason::Held], &[(440.0, 82.0), (360.0, 82.0)], "hold", (386.0, 96.0)),
    arrow(&[Ready], HoldingPosition, &[Reason::Held], &[(375.0, 252.0), (375.0, 287.0)], "hold", (382.0, 274.0)),
    arrow(&[Done], HoldingPosition, &[Reason::Held], &[(375.0, 362.0), (375.0, 327.0)], "hold", (382.0, 350.0)),
    arrow(REST, Seeking, &[Reason::Started], &[(460.0, 222.0), (610.0, 222.0)], "start", (490.0, 216.0)),
    arrow(REST, Guiding, &[Reason::Started], &[(460.0, 410.0), (610.0, 410.0)], "guide", (490.0, 404.0)),
    arrow(
        &[Positioning],
        Guiding,
        &[Reason::Started],
        &[(240.0, 66.0), (215.0, 66.0), (215.0, 534.0), (370.0, 534.0), (370.0, 504.0), (650.0, 504.0), (650.0, 424.0)],
        "guide",
        (222.0, 140.0),
    ),
    arrow(
        &[Guiding],
        Positioning,
        &[Reason::Held],
        &[(690.0, 424.0), (690.0, 513.0), (379.0, 513.0), (379.0, 543.0), (205.0, 543.0), (205.0, 80.0), (240.0, 80.0)],
        "hold",
        (170.0, 140.0),
    ),
    arrow(
        &[Seeking],
        Done,
        &[Reason::PathEnd, Reason::PathStop],
        &[(585.0, 372.0), (445.0, 372.0)],
        "end of the work",
        (480.0, 366.0),
    ),
    arrow(&[Eroding], Done, ENDS, &[(585.0, 372.0), (445.0, 372.0)], "end of the work", (480.0, 366.0)),
    arrow(
        &[Seeking],
        Lifting,
        &[Reason::PathEnd, Reason::PathStop],
        &[(585.0, 436.0), (530.0, 436.0), (530.0, 455.0)],
        "its end, with a lift",
        (462.0, 448.0),
    ),
    arrow(
        &[Eroding],
        Lifting,
        ENDS,
        &[(585.0, 436.0), (530.0, 436.0), (530.0, 455.0)],
        "its end, with a lift",
        (462.0, 448.0),
    ),
    arrow(&[Lifting], Done, &[Reason::Lifted], &[(455.0, 455.0), (455.0, 395.0), (445.0, 395.0)], "", (0.0, 0.0)),
    arrow(
        &[Lifting],
        HoldingPosition,
        &[Reason::Held],
        &[(440.0, 475.0), (298.0, 475.0), (298.0, 320.0), (305.0, 320.0)],
        "hold",
        (390.0, 488.0),
    ),
    arrow(
        &[Seeking, Eroding, Guiding, Retreating],
        HoldingPosition,
        &[Reason::Held],
        &[(585.0, 307.0), (445.0, 307.0)],
        "hold",
        (490.0, 301.0),
    ),
    arrow(&[Seeking], Eroding, &[Reason::WorkFound], &[(660.0, 244.0), (660.0, 285.0)], "work found", (667.0, 269.0)),
    arrow(
        &[Seeking],
        Retreating,
        &[Reason::Short],
        &[(730.0, 212.0), (900.0, 212.0), (900.0, 285.0)],
        "short",
        (752.0, 206.0),
    ),
    arrow(
        &[Retreating],
        Seeking,
        &[Reason::GapRecovered],
        &[(840.0, 285.0), (840.0, 234.0), (730.0, 234.0)],
        "clear",
        (752.0, 249.0),
    ),
    arrow(&[Eroding], Retreating, &[Reason::Short], &[(730.0, 298.0), (810.0, 298.0)], "short", (752.0, 292.0)),
    arrow(&[Retreating], Eroding, &[Reason::GapRecovered], &[(810.0, 318.0), (730.0, 318.0)], "clear", (752.0, 333.0)),
    arrow(
        &[Eroding],
        Jumping,
        &[Reason::Jumped, Reason::JumpedLow],
        &[(610.0, 292.0), (597.0, 292.0), (597.0, 134.0), (640.0, 134.0), (640.0, 108.0)],
        "jump",
        (646.0, 130.0),
    ),
    arrow(
        &[Jumping],
        Eroding,
        &[Reason::Returned],
        &[(700.0, 108.0), (700.0, 134.0), (744.0, 134.0), (744.0, 290.0), (730.0, 290.0)],
        "back",
        (706.0, 130.0),
    ),
    arrow(
        &[Jumping],
        HoldingPosition,
        &[Reason::Held],
        &[(610.0, 96.0), (575.0, 96.0), (575.0, 317.0), (445.0, 317.0)],
        "hold",
        (490.0, 331.0),
    ),
    arrow(
        &[Jumping],
        Positioning,
        &[Reason::Held],
        &[(610.0, 76.0), (580.0, 76.0), (580.0, 30.0), (300.0, 30.0), (300.0, 50.0)],
        "quick stop",
        (400.0, 24.0),
    ),
    arrow(
        &[Seeking, Eroding],
        Inching,
        &[Reason::StrokeEnd],
        &[(862.0, 160.0), (862.0, 108.0)],
        "end of the stroke",
        (754.0, 152.0),
    ),
    arrow(&[Inching], Eroding, &[Reason::Carried], &[(895.0, 108.0), (895.0, 160.0)], "carried", (901.0, 140.0)),
    arrow(&[Inching], Seeking, &[Reason::Carried], &[(895.0, 108.0), (895.0, 160.0)], "", (901.0, 140.0)),
    arrow(
        &[Inching],
        HoldingPosition,
        &[Reason::CarryRefused, Reason::NotTouched, Reason::Held],
        &[(870.0, 64.0), (870.0, 44.0), (590.0, 44.0), (590.0, 289.0), (445.0, 289.0)],
        "hold, refused, no bottom",
        (744.0, 38.0),
    ),
    arrow(
        &[Inching],
        Positioning,
        &[Reason::Held],
        &[(905.0, 64.0), (905.0, 18.0), (315.0, 18.0), (315.0, 50.0)],
        "quick stop",
        (744.0, 13.0),
    ),
    arrow(
        &[Guiding],
        Retreating,
        &[Reason::Short],
        &[(730.0, 412.0), (900.0, 412.0), (900.0, 329.0)],
        "short",
        (752.0, 427.0),
    ),
    arrow(
        &[Retreating],
        Guiding,
        &[Reason::GapRecovered],
        &[(840.0, 329.0), (840.0, 390.0), (730.0, 390.0)],
        "clear",
        (752.0, 384.0),
    ),
    arrow(
        &[Fault],
        Disabled,
        &[Reason::FaultReset],
        &[(610.0, 550.0), (12.0, 550.0), (12.0, 292.0), (40.0, 292.0)],
        "reset",
        (450.0, 544.0),
    ),
];

fn agrees() -> Result<(), String> {
    let each = |arrow: &'static Arrow| {
        let pairs = arrow.from.iter().flat_map(|from| arrow.reasons.iter().map(move |reason| (*from, *reason)));
        pairs.map(move |(from, reason)| (from, arrow.to, reason))
    };
    let drawn: Vec<_> = ARROWS.iter().flat_map(each).collect();
    if let Some(change) = TRANSITIONS.iter().find(|change| !drawn.contains(change)) {
        return Err(format!("the picture of the states has no arrow for {change:?}"));
    }
    match drawn.iter().find(|change| !TRANSITIONS.contains(change)) {
        Some(change) => Err(format!("the picture of the states has an arrow for {change:?}, which does not happen")),
        None => Ok(()),
    }
}

pub fn draw() -> Result<String, String> {
    agrees()?;
    let mut sheet = Sheet::new(960, 650, "States of the head and what changes them");
    sheet.rect((290.0, 175.0), (170.0, 250.0), Fill::Light);
    sheet.text((375.0, 200.0), 13, Anchor::Middle, "loop closed, at rest");
    sheet.rect((585.0, 160.0), (365.0, 285.0), Fill::Light);
    sheet.text((604.0, 182.0), 13, Anchor::Start, "pulses on");
    for state in State::ALL {
        let (at, size) = place(state);
        let fill = match state {
            Fault => Fill::Red,
            state if state.pulses() => Fill::Orange,
            _ => Fill::Blue,
        };
        sheet.labelled(at, size, fill, &state.name().replace('_', " "));
    }
    for arrow in ARROWS {
        sheet.arrow(arrow.points);
        sheet.text(arrow.at, 13, Anchor::Start, arrow.label);
    }
    sheet.arrow(&[(670.0, 485.0), (670.0, 520.0)]);
    sheet.text((670.0, 478.0), 13, Anchor::Middle, "a fault, from every state");
    sheet.arrow(&[(100.0, 235.0), (100.0, 270.0)]);
    sheet.text((100.0, 212.0), 13, Anchor::Middle, "disable,");
    sheet.text((100.0, 228.0), 13, Anchor::Middle, "from every state but fault");
    Ok(sheet.finish())
}
