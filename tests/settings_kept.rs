//! Whatever a setting changes in what a task runs, its second copy shows.

use edm_servo_head::kept::{Kept, Parts};
use edm_servo_head::settings::{Active, Declared, Kind, Settings};

/// Other words that a setting may have: those that its neighbours let it have are among them.
fn words(kind: &Kind, now: u32) -> Vec<u32> {
    match kind {
        Kind::Number { min, max } => {
            let value = f32::from_bits(now);
            let near = [value * 0.99, value * 1.01, value + 1.0, value - 1.0, *min, *max];
            near.map(|value| value.clamp(*min, *max).to_bits()).to_vec()
        }
        Kind::Integer { min, max } => vec![(now + 1).clamp(*min, *max), now.saturating_sub(1).clamp(*min, *max)],
        Kind::Flag => vec![1 - now],
        Kind::Choice(names) => (0..names.len() as u32).filter(|word| *word != now).collect(),
    }
}

/// Whether the copy of the one agrees with the other in every look of two rounds.
fn agrees<T: Parts + Copy>(copy: &T, run: &T) -> bool {
    let mut kept = Kept::NEW;
    assert!(kept.agrees(copy));
    (0..2 * T::PARTS + 2).all(|_| kept.agrees(run))
}

#[track_caller]
fn expect<T: Parts + Copy + PartialEq>(key: &str, before: &T, after: &T) -> bool {
    assert!(agrees(before, before) && agrees(after, after), "{key}");
    assert_eq!(agrees(before, after), before == after, "{key}");
    before != after
}

/// How many of the four tasks run something else.
fn changes(key: &str, before: &Active, after: &Active) -> usize {
    let differ = [
        expect(key, &before.gap, &after.gap),
        expect(key, &before.head, &after.head),
        expect(key, &before.head.follow(), &after.head.follow()),
        expect(key, &before.head.supervision(), &after.head.supervision()),
    ];
    differ.into_iter().filter(|differs| *differs).count()
}

#[test]
fn every_setting_that_changes_what_a_task_runs_is_in_a_part_that_is_compared() {
    let settings = Settings::default();
    let before = settings.build().unwrap();
    let (mut seen, mut unseen) = (0, Vec::new());
    for (index, field) in Settings::FIELDS.iter().enumerate() {
        let mut changed = 0;
        for word in words(&field.kind, settings.word(index).unwrap()) {
            let mut other = settings;
            other.put_word(index, word).unwrap();
            if let Ok(after) = other.build() {
                changed += changes(field.key, &before, &after);
            }
        }
        seen += changed;
        if changed == 0 {
            unseen.push(field.key);
        }
    }
    assert!(seen > 100, "{seen}");
    // They are the reflex's, the generator's, the node's, or wait for another setting.
    println!("in no task by themselves: {unseen:?}");
    assert!(unseen.len() < Settings::COUNT / 3, "{unseen:?}");
}
