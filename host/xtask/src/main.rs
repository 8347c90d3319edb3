//! What a cargo alias cannot do.
fn main() {}
