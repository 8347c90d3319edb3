//! What .ci/run compiles beside every step to see how fast its computer is now. Never changed: the seconds of all runs are counted by it.

use std::collections::{BTreeMap, HashMap, VecDeque};

pub fn words(text: &str) -> BTreeMap<String, Vec<usize>> {
    let mut found: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (at, word) in text.split_whitespace().enumerate() {
        found.entry(word.to_lowercase()).or_default().push(at);
    }
    found
}

pub fn counts(text: &str) -> HashMap<char, u64> {
    let mut found = HashMap::new();
    for c in text.chars() {
        *found.entry(c).or_insert(0) += 1;
    }
    found
}

pub fn sorted(mut of: Vec<(f64, String)>) -> Vec<(f64, String)> {
    of.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
    of
}

pub fn greatest(of: &[i64], n: usize) -> Vec<i64> {
    let mut last = VecDeque::new();
    of.iter()
        .map(|x| {
            last.push_back(*x);
            if last.len() > n {
                last.pop_front();
            }
            last.iter().copied().max().unwrap_or(0)
        })
        .collect()
}

pub fn shown(of: &BTreeMap<String, Vec<usize>>) -> String {
    format!("{of:#?} {}", of.len())
}
