//! The pictures of docs/pictures that are drawn from the code: `cargo xtask docs` writes them.

mod blocks;
mod millisecond;
mod states;
mod svg;

/// Name in docs/ and text of each.
///
/// # Errors
/// What of the code no longer fits its picture.
pub fn render() -> Result<[(&'static str, String); 3], String> {
    Ok([
        ("pictures/blocks.svg", blocks::draw()?),
        ("pictures/states.svg", states::draw()?),
        ("pictures/millisecond.svg", millisecond::draw()?),
    ])
}
