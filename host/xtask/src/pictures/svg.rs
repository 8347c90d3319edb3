//! As much of SVG as the pictures need: boxes, text, arrows. Lengths are px; the background is white, for dark pages too.

use std::fmt::Write;

/// A colour of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fill {
    /// Nothing stands out.
    Plain,
    /// Of a kind with others, lightly.
    Light,
    /// What to look at first.
    Blue,
    /// What pulses, or is made.
    Orange,
    /// What went wrong.
    Red,
}

impl Fill {
    const fn colour(self) -> &'static str {
        match self {
            Fill::Plain => "#ffffff",
            Fill::Light => "#f1f3f5",
            Fill::Blue => "#d0e4f7",
            Fill::Orange => "#fde3c4",
            Fill::Red => "#f8d2d0",
        }
    }
}

/// Where a text is held.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// At its beginning.
    Start,
    /// In its middle.
    Middle,
    /// At its end.
    End,
}

/// A picture under way.
pub struct Sheet {
    text: String,
}

impl Sheet {
    /// A white sheet; `title` is what a screen reader says.
    pub fn new(width: u32, height: u32, title: &str) -> Sheet {
        let mut sheet = Sheet { text: String::new() };
        sheet.line(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"Helvetica, Arial, sans-serif\">"
        ));
        sheet.line(format_args!("<title>{}</title>", escaped(title)));
        sheet.line(format_args!(
            "<defs><marker id=\"tip\" viewBox=\"0 0 10 10\" refX=\"9\" refY=\"5\" markerWidth=\"8\" markerHeight=\"8\" \
             orient=\"auto\"><path d=\"M0 0L10 5L0 10z\" fill=\"#333\"/></marker></defs>"
        ));
        sheet.line(format_args!("<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>"));
        sheet
    }

    fn line(&mut self, text: std::fmt::Arguments<'_>) {
        // A string takes everything.
        let _ = writeln!(self.text, "{text}");
    }

    /// A box with its upper left corner at `(x, y)`.
    pub fn rect(&mut self, (x, y): (f64, f64), (width, height): (f64, f64), fill: Fill) {
        let fill = fill.colour();
        self.line(format_args!(
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" rx=\"3\" fill=\"{fill}\" stroke=\"#555\"/>"
        ));
    }

    /// A box with a name in its middle.
    pub fn labelled(&mut self, at: (f64, f64), size: (f64, f64), fill: Fill, name: &str) {
        self.rect(at, size, fill);
        self.text((at.0 + size.0 / 2.0, at.1 + size.1 / 2.0 + 5.0), 14, Anchor::Middle, name);
    }

    /// A text whose base line is at `y`.
    pub fn text(&mut self, (x, y): (f64, f64), size: u32, anchor: Anchor, text: &str) {
        self.styled((x, y), size, anchor, "", text);
    }

    /// A slanted text.
    pub fn slanted(&mut self, at: (f64, f64), size: u32, anchor: Anchor, text: &str) {
        self.styled(at, size, anchor, " font-style=\"italic\"", text);
    }

    fn styled(&mut self, (x, y): (f64, f64), size: u32, anchor: Anchor, style: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.line(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"#111\"{style}>{}</text>",
            escaped(text)
        ));
    }

    /// An arrow through these points.
    pub fn arrow(&mut self, points: &[(f64, f64)]) {
        self.path(points, "stroke=\"#333\" marker-end=\"url(#tip)\"");
    }

    /// A thin line through these points.
    pub fn rule(&mut self, points: &[(f64, f64)]) {
        self.path(points, "stroke=\"#bbb\"");
    }

    fn path(&mut self, points: &[(f64, f64)], style: &str) {
        let points: Vec<_> = points.iter().map(|(x, y)| format!("{x},{y}")).collect();
        self.line(format_args!("<polyline points=\"{}\" fill=\"none\" {style}/>", points.join(" ")));
    }

    /// The file.
    pub fn finish(mut self) -> String {
        self.text.push_str("</svg>\n");
        self.text
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
