//! A case that breaks an invariant, made as short as it goes: halves, quarters and so on of its steps are left out as long as
//! the same invariant breaks, then the time between steps is halved.

use super::case::Case;
use super::rig::Broken;

/// Plays at the most.
const PLAYS: u32 = 600;

/// The shortest case found that breaks the same invariant; `play` says what a case breaks.
pub fn shrink(case: &Case, broken: &Broken, mut play: impl FnMut(&Case) -> Option<Broken>) -> (Case, Broken) {
    let mut best = (case.clone(), broken.clone());
    let mut plays = 0;
    let mut attempt = |case: Case, best: &mut (Case, Broken)| {
        plays += 1;
        let found = (plays <= PLAYS).then(|| play(&case)).flatten().filter(|found| found.what == broken.what);
        let better = found.is_some();
        if let Some(found) = found {
            // What comes behind the break does not matter.
            let mut case = case;
            case.steps.truncate(found.steps + 1);
            *best = (case, found);
        }
        better
    };
    best.0.steps.truncate(broken.steps + 1);
    let mut chunk = best.0.steps.len() / 2;
    while chunk > 0 {
        let mut at = 0;
        // The last step is the one that time is given to.
        while at + chunk < best.0.steps.len() {
            // Left out with their time, or without it.
            let shorter = without(&best.0, at, chunk, false);
            if !attempt(shorter, &mut best) {
                let silent = without(&best.0, at, chunk, true);
                if !attempt(silent, &mut best) {
                    at += chunk;
                }
            }
        }
        chunk /= 2;
    }
    for at in 0..best.0.steps.len() {
        while let Some(step) = best.0.steps.get(at).filter(|step| step.after > 1) {
            let mut sooner = best.0.clone();
            let half = step.after / 2;
            sooner.steps.iter_mut().skip(at).take(1).for_each(|step| step.after = half);
            if !attempt(sooner, &mut best) {
                break;
            }
        }
    }
    best
}

/// A case without some steps; the time that they take passes all the same if it is `kept`.
fn without(case: &Case, at: usize, count: usize, kept: bool) -> Case {
    let mut shorter = case.clone();
    let gone: u64 = shorter.steps.drain(at..at + count).map(|step| step.after).sum();
    if let (true, Some(next)) = (kept, shorter.steps.get_mut(at)) {
        next.after += gone;
    }
    shorter
}

#[cfg(test)]
mod tests {
    use super::super::case::{Action, Step};
    use super::*;

    /// Breaks when frame 3 has been followed by frame 7, at least ten ticks later, and there has been a step after that.
    fn play(case: &Case) -> Option<Broken> {
        let (mut third, mut now) = (None, 0);
        for (steps, step) in case.steps.iter().enumerate() {
            now += step.after;
            match (&step.action, third) {
                (Action::Frame(3, _), _) => third = Some(now),
                (Action::Frame(7, _), Some(then)) if now >= then + 10 && steps + 1 < case.steps.len() => {
                    return Some(Broken { steps: steps + 1, what: "7 after 3", how: now.to_string() });
                }
                _ => {}
            }
        }
        None
    }

    #[test]
    fn what_is_left_is_what_it_takes() {
        let steps = (0..100).map(|id| Step { after: 20, action: Action::Frame(id, vec![]) }).collect();
        let case = Case { seed: 1, steps };
        let (short, broken) = shrink(&case, &play(&case).unwrap(), play);
        let ids: Vec<&Action> = short.steps.iter().map(|step| &step.action).take(2).collect();
        assert_eq!(ids, [&Action::Frame(3, vec![]), &Action::Frame(7, vec![])], "{short}");
        assert_eq!((short.steps.len(), broken.what), (3, "7 after 3"), "{short}");
        assert!((10..20).contains(&short.steps[1].after), "{short}");
        assert_eq!(play(&short).unwrap(), broken);
    }

    #[test]
    fn a_case_that_breaks_something_else_is_no_shorter_one() {
        let case = Case { seed: 1, steps: vec![Step { after: 0, action: Action::Frame(1, vec![]) }; 4] };
        let broken = Broken { steps: 3, what: "a", how: String::new() };
        let other = |_: &Case| Some(Broken { steps: 1, what: "b", how: String::new() });
        assert_eq!(shrink(&case, &broken, other).0, case);
    }
}
