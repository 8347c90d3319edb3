//! Texts of docs/bring-up.md: titles of its steps, what to see, what to do otherwise, and named limits. Nothing of it is
//! repeated in this program.

/// The page.
const PAGE: &str = include_str!("../../../docs/bring-up.md");

/// Steps and their titles, in their order.
pub fn steps() -> impl Iterator<Item = (u8, &'static str)> {
    PAGE.lines().filter_map(|line| {
        let (number, title) = line.strip_prefix("## ")?.split_once(". ")?;
        Some((number.parse().ok()?, title))
    })
}

/// The cells of a step's row of a table whose first cell begins like this, plain; empty where there is none.
pub fn row(step: u8, begins: &str) -> Vec<String> {
    let heading = format!("## {step}. ");
    let lines = PAGE.lines().skip_while(|line| !line.starts_with(&heading)).skip(1);
    let mut of_step = lines.take_while(|line| !line.starts_with("## "));
    let row = of_step.find(|line| line.strip_prefix("| ").is_some_and(|rest| plain(rest).starts_with(begins)));
    let cells = row.and_then(|line| line.strip_prefix("| ")?.strip_suffix('|'));
    cells.map(|cells| cells.split(" | ").map(|cell| plain(cell).trim().to_owned()).collect()).unwrap_or_default()
}

/// Advice of that row.
pub fn if_not(step: u8, begins: &str) -> String {
    row(step, begins).pop().unwrap_or_default()
}

/// A number that the page gives with a name, in its unit: of `sense.least` in `9.2 V` it is 9.2. Of a range its end.
pub fn number(name: &str) -> Option<f64> {
    let (_, behind) = PAGE.split_once(&format!("<!--={name}-->"))?;
    let (text, _) = behind.split_once("<!--/-->")?;
    let text = text.rsplit("..").next()?;
    text.split_whitespace().next()?.parse().ok()
}

/// The number behind a sign in a row: of `+- ` in `code 2048 +- 10` it is 10.
pub fn behind(step: u8, begins: &str, sign: &str) -> Option<f64> {
    let row = row(step, begins).join(" ");
    let (_, rest) = row.split_once(sign)?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
    rest[..end].parse().ok()
}

/// Without what a reader of the page does not see.
fn plain(text: &str) -> String {
    let mut rest = text;
    let mut plain = String::new();
    while let Some((before, behind)) = rest.split_once("<!--") {
        plain += before;
        rest = behind.split_once("-->").map_or("", |(_, after)| after);
    }
    (plain + rest).replace("**", "")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_its_steps_in_order_and_rows_are_found_without_their_marks() {
        let steps: Vec<_> = steps().collect();
        assert!(steps.iter().map(|(number, _)| *number).eq(1..=13), "{steps:?}");
        assert_eq!(steps[5], (6, "Encoder"));
        assert!(if_not(6, "the position in the log").starts_with("runs backward: swap A+"));
        assert_eq!(row(8, "nothing near")[1], "9.2 V to 13.0 V (11.1 V nominal)");
        assert!(row(6, "nothing near").is_empty(), "that row is of another step");
        assert_eq!((number("sense.least"), number("gap.zero_volts"), number("none")), (Some(9.2), Some(0.9), None));
    }
}
