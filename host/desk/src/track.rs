//! A G-code program on its way into the head, segment by segment, while it is eroded.
//!
//! X0 Y0 of the program is where the head's set points of X and Y are 0, as at power-on; who drives these axes follows 200Eh:12
//! and 13. Where they are elsewhere, the path begins with a line to them at the height at which pulses begin.

use crate::head::{Head, at};
use crate::sheet::Value;
use crate::{Failure, words};
use edm_gcode::Program;
use edm_servo_head::path::{Piece, Shape};
use std::sync::Arc;

/// Segments appended between two samples: their transfers must not hold up the heartbeat.
const AT_ONCE: usize = 8;
/// The largest feed, which F bounds.
const FEED_MAX: &str = "feed.max_um_s";

/// A program that is eroded.
pub struct Track<'a> {
    head: &'a Head,
    program: Arc<Program>,
    /// All segments, with the line that each belongs to; nm below home.
    pieces: Vec<(usize, Piece)>,
    /// The next to be appended.
    next: usize,
    /// Segments that the head has had before.
    before: i64,
    /// Path coordinate at which the program begins, um.
    from_um: Option<i64>,
    /// Length of what comes before the program, um.
    lead_um: f64,
    /// The setting, and what it is now, um/s.
    feed_max: f64,
    allowed: f64,
}

/// Where a head is on its program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Line of the program.
    pub line: usize,
    /// Length of path behind it, mm.
    pub done_mm: f64,
    /// Set points of X and Y, mm.
    pub beside_mm: [f64; 2],
}

impl<'a> Track<'a> {
    /// Prepares a program whose Z0 is a surface, for a head at rest above it; counts.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn new(head: &'a Head, program: Arc<Program>, surface: i64) -> Result<Track<'a>, Failure> {
        let per_mm = head.counts_per_mm()?;
        let nm = |counts: i64| (counts as f64 / per_mm * 1e6).round() as i64;
        let (here, surface) = (nm(head.whole(at::POSITION)?), nm(surface));
        let beside = [head.whole(at::BESIDE[0])?, head.whole(at::BESIDE[1])?];
        let first = program.moves.first().map_or(1, |first| first.line);
        let line = |to| (first, Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false });
        let mut pieces = Vec::new();
        if beside != [0; 2] {
            pieces.push(line([here, 0, 0]));
        }
        // Pulses begin above the work: straight down to it, unless the program says how it comes to it.
        pieces.push(line([surface, 0, 0]));
        let [x, y] = beside.map(|nm| nm as f64);
        let lead_um = (x.hypot(y) + (surface - here).abs() as f64) * 1e-3;
        pieces.extend(program.moves.iter().map(|one| {
            let [down, x, y] = one.piece.to;
            (one.line, Piece { to: [down + surface, x, y], ..one.piece })
        }));
        pieces.retain({
            let mut last = [here, beside[0], beside[1]];
            move |(_, piece)| {
                let leads = piece.to != last || piece.shape != Shape::Line;
                last = piece.to;
                leads
            }
        });
        head.set(at::COMMIT, 0)?;
        let feed_max = head.setting(FEED_MAX)?;
        let before = head.whole(at::APPENDED)?;
        Ok(Track { head, program, pieces, next: 0, before, from_um: None, lead_um, feed_max, allowed: feed_max })
    }

    /// Appends what fits.
    ///
    /// # Errors
    /// What the head refuses, with the line; those of the transfers.
    pub fn append(&mut self) -> Result<(), Failure> {
        let room = self.head.whole(at::SPACE)?.max(0) as usize;
        for _ in 0..room.min(AT_ONCE) {
            let Some((line, piece)) = self.pieces.get(self.next) else { break };
            let Piece { shape, to: [down, x, y], centre: [u, v], .. } = *piece;
            for (part, value) in (1..).zip([down, x, y, u.into(), v.into(), shape as i64, 0]) {
                self.head.set(at::piece(part), value)?;
            }
            self.head.set(at::COMMIT, 1)?;
            // The head answers within milliseconds.
            let mut refused = 0;
            while refused == 0 && self.head.whole(at::APPENDED)? - self.before <= self.next as i64 {
                refused = self.head.whole(at::PIECE_REFUSED)? as u8;
            }
            if refused != 0 {
                let words = words::refusal(refused);
                return Err(Failure::Failed(format!(
                    "program line {line}: the head refuses: {}; {}",
                    words.name, words.advice
                )));
            }
            self.next += 1;
        }
        Ok(())
    }

    /// Whether the head has all of it.
    pub fn is_appended(&self) -> bool {
        self.next == self.pieces.len()
    }

    /// Where the head is. F of the line under way bounds the feed.
    ///
    /// # Errors
    /// Those of the transfers.
    pub fn place(&mut self) -> Result<Place, Failure> {
        let head = self.head;
        let number = head.whole(at::SEGMENT)? - self.before - 1;
        let under_way = self.pieces.get(number.max(0) as usize).or(self.pieces.last());
        let line = under_way.map_or(1, |(line, _)| *line);
        let path = head.whole(at::PATH)?;
        let from = *self.from_um.get_or_insert(path);
        let done_mm = ((path - from) as f64 - self.lead_um).max(0.0) * 1e-3;
        // A line has one move.
        let feed = self.program.moves.iter().find(|one| one.line == line).and_then(|one| one.feed);
        self.allow(feed.map_or(self.feed_max, |feed| feed.min(self.feed_max)))?;
        let beside_mm = [head.whole(at::BESIDE[0])? as f64 * 1e-6, head.whole(at::BESIDE[1])? as f64 * 1e-6];
        Ok(Place { line, done_mm, beside_mm })
    }

    /// The feed of the setting again.
    ///
    /// # Errors
    /// Those of the transfer.
    pub fn end(&mut self) -> Result<(), Failure> {
        self.allow(self.feed_max)
    }

    fn allow(&mut self, feed: f64) -> Result<(), Failure> {
        if feed == self.allowed {
            return Ok(());
        }
        let object = self.head.sheet.setting(FEED_MAX).map_err(Failure::Failed)?;
        let bytes = object.encode(&Value::Real(feed as f32)).unwrap_or_default();
        self.head.sdo.write(object.address, &bytes)?;
        self.allowed = feed;
        Ok(())
    }
}
