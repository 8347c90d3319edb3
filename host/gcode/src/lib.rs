//! A small part of G-code as pieces of path: `WORDS`.
//!
//! Z is up, as on a machine; a head counts down. Z0 is the surface of the work, X0 Y0 is where the head is. The gap decides how
//! fast a path is eroded: F is a bound for that, in units a minute, and G0 is G1 without the bound. What a post writes at the
//! beginning and means nothing here is passed over. `examples/gcode.py` accepts the same.
//!
//! A program that switches pulses (M3, M5), as LinuxCNC runs it (`examples/linuxcnc`), erodes between the two: what comes before M3
//! leads to the start of the path, and what comes after M5 out of the work.

mod program;

pub use program::Program;

use edm_servo_head::path::{AXES, INCONSISTENCY, Piece, Plane, Shape, Turn};
use g_code::emit::Field;
use g_code::parse::ast::{Span, Spanned};
use g_code::parse::snippet_parser;

/// What is understood; G40, G49, G54, G80 and G94 say what holds here anyway, G4, G10 and M52 what a head needs not be told.
const WORDS: &str = "G0 to G4, G10, G17 to G21, G40, G49, G54, G80, G90, G91, G94, F, M2, M3 S, M5, M30, M52 P";
/// nm in a millimetre and in an inch.
const MM: f64 = 1e6;
const INCH: f64 = 25.4e6;
/// Smallest feed, um/s: that of feed.max_um_s.
const SLOWEST: f64 = 0.1;

/// A piece of path, and where it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Line of the program, from 1.
    pub line: usize,
    /// The word that says most of where it leads: Z, or else another one.
    pub word: String,
    /// The piece, nm from X0 Y0 Z0.
    pub piece: Piece,
    /// F, um/s, if it holds: no faster feed.
    pub feed: Option<f64>,
}

/// What holds until a line says otherwise.
struct Modal {
    /// Number of G0 to G3.
    motion: Option<u8>,
    plane: Plane,
    unit: f64,
    absolute: bool,
    /// um/s.
    feed: Option<f64>,
}

/// What a line gives.
#[derive(Default)]
struct Line {
    /// The word that says most of where the piece leads, and the piece.
    piece: Option<(String, Piece)>,
    /// The program ends with it.
    ends: bool,
    /// It switches pulses, before it moves.
    pulses: Option<(String, bool)>,
}

/// A letter with its number, and how it is written.
struct Word<'a> {
    letter: char,
    number: f64,
    text: &'a str,
}

/// Reads a program.
///
/// # Errors
/// What cannot be carried out, with line and word.
pub fn read(text: &str) -> Result<Vec<Move>, String> {
    let mut modal = Modal { motion: None, plane: Plane::Xy, unit: MM, absolute: true, feed: None };
    let mut at = [0; AXES];
    let mut moves = Vec::new();
    // Where pulses were switched off, once they were on; whether they are.
    let (mut off, mut on) = (None, None);
    for (number, line) in text.lines().enumerate() {
        let number = number + 1;
        let reported = |what: String| format!("line {number}: {what}");
        // A percent sign stands around a program and says nothing; in a comment there may be any letter.
        let plain = |c: char| match c {
            '%' => ' ',
            c if c.is_whitespace() => ' ',
            c if c.is_ascii_graphic() => c,
            _ => '?',
        };
        let ascii: String = line.chars().map(plain).collect();
        let words = words(&ascii).map_err(|wrong| reported(format!("{wrong}: not a word of G-code")))?;
        let Line { piece, ends, pulses } = modal.carry_out(&words, at).map_err(reported)?;
        match pulses {
            Some((word, true)) if on != Some(true) => {
                let [_, x, y] = at;
                if on.is_none() && (x, y) != (0, 0) {
                    return Err(reported(format!("{word}: the head is at X0 Y0, and erodes from there")));
                }
                if off.is_some_and(|off| off != at) {
                    return Err(reported(format!("{word}: must be where M5 was; a head erodes one path")));
                }
                if on.is_none() {
                    moves.clear();
                }
                on = Some(true);
            }
            Some((_, false)) if on == Some(true) => (on, off) = (Some(false), Some(at)),
            _ => {}
        }
        if let Some((word, piece)) = piece {
            at = piece.to;
            let feed = modal.feed.filter(|_| modal.motion != Some(0));
            if on != Some(false) {
                moves.push(Move { line: number, word, piece, feed });
            }
        }
        if ends {
            break;
        }
    }
    if moves.is_empty() { Err("no move".into()) } else { Ok(moves) }
}

/// The words of a line but its number; what is none, as an error.
fn words(line: &str) -> Result<Vec<Word<'_>>, &str> {
    // What a person would call the word at a place.
    let at = |offset: usize| {
        let offset = offset.min(line.trim_end().len().saturating_sub(1));
        let begin = line[..offset].rfind(' ').map_or(0, |space| space + 1);
        line[begin..].split(' ').next().unwrap_or(line)
    };
    let parsed = snippet_parser(line).map_err(|error| at(error.location.offset))?;
    if let Some(flag) = parsed.iter_flags().next() {
        return Err(at(flag.span().0));
    }
    if let Some(sum) = parsed.iter_checksums().next() {
        return Err(at(sum.span().0));
    }
    let mut words = Vec::new();
    for field in parsed.iter_fields() {
        let Span(begin, end) = field.span();
        let text = line.get(begin..end).unwrap_or(line);
        let Field { letters, value } = field.into();
        let mut letters = letters.chars().map(|letter| letter.to_ascii_uppercase());
        match (letters.next(), letters.next(), value.as_f64()) {
            (Some('N'), None, Some(_)) => {}
            (Some(letter), None, Some(number)) if letter != '$' => words.push(Word { letter, number, text }),
            _ => return Err(text),
        }
    }
    Ok(words)
}

/// Words of which a line may have one: they contradict each other.
fn group(letter: char, number: f64) -> Option<u8> {
    Some(match (letter, number) {
        ('G', 0.0..=4.0 | 10.0) => 0,
        ('G', 17.0..=19.0) => 1,
        ('G', 20.0..=21.0) => 2,
        ('G', 90.0..=91.0) => 3,
        ('M', 3.0 | 5.0) => 4,
        _ => return None,
    })
}

impl Modal {
    /// Takes the words of a line: the piece that they make from a point, and whether the program ends.
    fn carry_out(&mut self, words: &[Word<'_>], at: [i64; AXES]) -> Result<Line, String> {
        let mut given: Vec<(char, &Word<'_>)> = Vec::new();
        let (mut ends, mut pulses) = (false, None);
        let has = |letter, number| words.iter().any(|word: &Word<'_>| (word.letter, word.number) == (letter, number));
        let (waits, offset) = (has('G', 4.0), has('G', 10.0));
        for (place, word) in words.iter().enumerate() {
            let Word { letter, number, text } = word;
            let group = group(*letter, *number);
            let same = |other: &&Word<'_>| group.is_some() && self::group(other.letter, other.number) == group;
            if let Some(other) = words.iter().take(place).find(same) {
                return Err(format!("{text}: {} is in the same line", other.text));
            }
            match (letter, number) {
                ('G', 0.0..=3.0) if number.fract() == 0.0 => self.motion = Some(*number as u8),
                ('G', 17.0) => self.plane = Plane::Xy,
                ('G', 18.0) => self.plane = Plane::Zx,
                ('G', 19.0) => self.plane = Plane::Yz,
                ('G', 20.0) => self.unit = INCH,
                ('G', 21.0) => self.unit = MM,
                ('G', 4.0 | 40.0 | 49.0 | 54.0 | 80.0 | 94.0) => {}
                // Z0 is the surface, whatever a machine has to be told to have it there.
                ('G', 10.0) if has('P', 1.0) && (has('L', 2.0) || has('L', 20.0)) => {}
                ('G', 10.0) => return Err(format!("{text}: must be G10 L2 P1 or G10 L20 P1")),
                ('G', 90.0) => self.absolute = true,
                ('G', 91.0) => self.absolute = false,
                ('M', 2.0 | 30.0) => ends = true,
                ('M', 3.0 | 5.0) => pulses = Some((text.to_string(), *number == 3.0)),
                ('M', 52.0) => {}
                ('P', _) if waits || offset || has('M', 52.0) => {}
                ('L', _) if offset => {}
                ('S', _) if has('M', 3.0) => {}
                ('X' | 'Y' | 'Z', _) if offset => {}
                ('F' | 'R' | 'X' | 'Y' | 'Z' | 'I' | 'J' | 'K', _) => {
                    if given.iter().any(|(other, _)| other == letter) {
                        return Err(format!("{text}: {letter} is twice in the line"));
                    }
                    given.push((*letter, word));
                }
                _ => return Err(format!("{text}: must be one of {WORDS}")),
            }
        }
        let spelled =
            |letters: &str| given.iter().find(|(letter, _)| letters.contains(*letter)).map(|(_, word)| word.text);
        // The unit may stand behind it.
        if let Some((_, word)) = given.iter().find(|(letter, _)| *letter == 'F') {
            let feed = word.number * self.unit / 60e3;
            if !(SLOWEST..f64::INFINITY).contains(&feed) {
                let least = (SLOWEST * 60e9 / self.unit).ceil() / 1e6;
                return Err(format!("{}: a feed must be {least} or more, in units a minute", word.text));
            }
            self.feed = Some(feed);
        }
        let Some(word) = spelled("Z").or(spelled("XY")).or(spelled("IJKR")) else {
            return Ok(Line { piece: None, ends, pulses });
        };
        let piece = self.piece(word, &given, at)?;
        Ok(Line { piece: piece.map(|piece| (word.into(), piece)), ends, pulses })
    }

    /// The piece that words of a line make; none where they lead nowhere.
    fn piece(&self, word: &str, given: &[(char, &Word<'_>)], at: [i64; AXES]) -> Result<Option<Piece>, String> {
        let length = |letter: char| {
            given.iter().find(|(other, _)| *other == letter).map(|(_, word)| (word.number * self.unit).round() as i64)
        };
        let spelled =
            |letters: &str| given.iter().find(|(letter, _)| letters.contains(*letter)).map(|(_, word)| word.text);
        let Some(motion) = self.motion else { return Err(format!("{word}: no G0 to G3 before the first move")) };
        let end = |from: i64, by: Option<i64>| match by {
            None => from,
            Some(by) if self.absolute => by,
            Some(by) => from.saturating_add(by),
        };
        let [down, x, y] = at;
        let to = [end(-down, length('Z')).saturating_neg(), end(x, length('X')), end(y, length('Y'))];
        let mut piece = Piece { shape: Shape::Line, to, centre: [0; 2], mark: false, stop: false };
        if motion < 2 {
            if let Some(word) = spelled("IJKR") {
                return Err(format!("{word}: only an arc has a centre or a radius"));
            }
            return Ok((to != at).then_some(piece));
        }
        // Down is Z turned around, and so is the way round in its planes.
        let (name, centre, other) = match self.plane {
            Plane::Xy => ("G17 has its centre in I and J", [('I', 1), ('J', 1)], "K"),
            Plane::Zx => ("G18 has its centre in I and K", [('K', -1), ('I', 1)], "J"),
            Plane::Yz => ("G19 has its centre in J and K", [('J', 1), ('K', -1)], "I"),
        };
        let forward = (motion == 3) == (self.plane == Plane::Xy);
        let turn = if forward { Turn::Forward } else { Turn::Backward };
        piece.shape = Shape::of(self.plane, turn);
        let nm: [i64; 2] = match (length('R'), spelled("R"), spelled("IJK")) {
            (Some(_), _, Some(word)) => return Err(format!("{word}: an arc with R must have no other centre")),
            (Some(radius), Some(word), None) => {
                let by = [0, 1, 2].map(|axis| (to[axis] - at[axis]) as f64);
                let chord = match self.plane {
                    Plane::Xy => [by[1], by[2]],
                    Plane::Zx => [by[0], by[1]],
                    Plane::Yz => [by[2], by[0]],
                };
                by_radius(chord, radius as f64, forward).map_err(|wrong| format!("{word}: {wrong}"))?
            }
            _ => {
                let wrong = spelled(other).map(str::to_owned);
                let missing = centre.iter().all(|(letter, _)| length(*letter).is_none()).then(|| format!("G{motion}"));
                if let Some(word) = wrong.or(missing) {
                    return Err(format!("{word}: an arc in {name}, or a radius in R"));
                }
                centre.map(|(letter, sign)| sign * length(letter).unwrap_or(0))
            }
        };
        for ((to, nm), (letter, _)) in piece.centre.iter_mut().zip(nm).zip(centre) {
            let far = |_| {
                let word = spelled("R").or(spelled(&letter.to_string())).unwrap_or(word);
                format!("{word}: the centre is farther away than the largest radius")
            };
            *to = i32::try_from(nm).map_err(far)?;
        }
        Ok(Some(piece))
    }
}

/// The centre of an arc from its beginning, nm: `chord` leads to its end. With a negative radius it is the longer way around.
fn by_radius(chord: [f64; 2], radius: f64, forward: bool) -> Result<[i64; 2], String> {
    let [u, v] = chord;
    let length = u.hypot(v);
    if length == 0.0 {
        return Err("an arc with R must not end where it begins; give a full circle by I, J or K".into());
    }
    // Ends in whole um may be that much too far apart for a half turn.
    if length > 2.0 * radius.abs() + INCONSISTENCY as f64 {
        return Err(format!("its ends are {:.3} mm apart, more than two radii", length / MM));
    }
    let aside = (radius * radius - length * length / 4.0).max(0.0).sqrt() / length;
    let left = if forward == (radius > 0.0) { aside } else { -aside };
    Ok([(u / 2.0 - left * v).round() as i64, (v / 2.0 + left * u).round() as i64])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn piece(shape: Shape, to: [i64; AXES], centre: [i32; 2]) -> Piece {
        Piece { shape, to, centre, mark: false, stop: false }
    }

    #[test]
    fn a_program_is_lines_and_arcs_in_nm_with_z_turned_around() {
        let program = "%\nN1 G21 G90 (10 µm)\nG1 X1 Z-0.5 F2\nG3 X3 I1 ; half around\ng91 g2 x-2 i-1 z-.25\n\
                       G18 G3 Z1 X1 K0 I1\nG20 G0X1\nM2\nG1 X9";
        let found: Vec<(usize, Piece)> = read(program).unwrap().iter().map(|m| (m.line, m.piece)).collect();
        assert_eq!(
            found,
            [
                (3, piece(Shape::Line, [500_000, 1_000_000, 0], [0; 2])),
                (4, piece(Shape::Xy, [500_000, 3_000_000, 0], [1_000_000, 0])),
                (5, piece(Shape::XyBack, [750_000, 1_000_000, 0], [-1_000_000, 0])),
                // From down toward X is backward from Z toward X.
                (6, piece(Shape::ZxBack, [-250_000, 2_000_000, 0], [0, 1_000_000])),
                (7, piece(Shape::Line, [-250_000, 27_400_000, 0], [0; 2])),
            ]
        );
    }

    #[test]
    fn the_planes_turn_as_seen_from_their_third_axis() {
        for (plane, centre, shapes) in [
            (17, "I1", [Shape::Xy, Shape::XyBack]),
            (18, "I1", [Shape::ZxBack, Shape::Zx]),
            (19, "J1", [Shape::YzBack, Shape::Yz]),
        ] {
            let found = read(&format!("G{plane}\nG3 {centre}\nG2 {centre}")).unwrap();
            assert_eq!(found.iter().map(|m| m.piece.shape).collect::<Vec<_>>(), shapes);
        }
    }

    #[test]
    fn an_arc_by_its_radius_is_the_one_by_its_centre_in_every_plane_and_either_way_around() {
        for (plane, end, minor, major) in [
            // A quarter turn, and the three quarters on the other side of the chord.
            ("G17", "X1 Y1", ["I0 J1", "I1 J0"], ["I1 J0", "I0 J1"]),
            ("G18", "Z1 X1", ["K0 I1", "K1 I0"], ["K1 I0", "K0 I1"]),
            ("G19", "Y1 Z1", ["J0 K1", "J1 K0"], ["J1 K0", "J0 K1"]),
        ] {
            for (n, motion) in ["G3", "G2"].into_iter().enumerate() {
                for (radius, centre) in [("R1", minor[n]), ("R-1", major[n])] {
                    let by = |how| read(&format!("{plane} {motion} {end} {how}")).unwrap()[0].piece;
                    assert_eq!(by(radius), by(centre), "{plane} {motion} {end} {radius}, {centre}");
                }
            }
        }
        // A half turn whose ends are rounded, in inch, and a helix.
        let found = read("G1 X0.001\nG20 G3 X0.1 Y0.02 Z-1 R.051").unwrap();
        let Piece { shape, to, centre, .. } = found[1].piece;
        assert_eq!((shape, to), (Shape::Xy, [25_400_000, 2_540_000, 508_000]));
        let far = |[u, v]: [f64; 2]| (f64::from(centre[0]) - u).hypot(f64::from(centre[1]) - v);
        assert!((far([0.0; 2]) - 1_295_400.0).abs() < 2.0 && (far([2_539_000.0, 508_000.0]) - 1_295_400.0).abs() < 2.0);
        assert!(read("G2 X2.001 R1").is_ok());
    }

    #[test]
    fn what_a_post_writes_around_a_program_is_passed_over() {
        let post = "%\nN10 G17 G21 G40 G49 G80 G90 G94 (head)\nN20 G01 X1 F2\nN30 M30\n%";
        assert_eq!(read(post), read("G1 X1 F2").map(|m| vec![Move { line: 3, ..m[0].clone() }]));
    }

    #[test]
    fn a_program_of_a_machine_erodes_between_its_switching_pulses_on_and_off() {
        let moves = read(include_str!("../../../examples/linuxcnc/hole.ngc")).unwrap();
        let line = piece(Shape::Line, [20_000, 0, 0], [0; 2]);
        assert_eq!(moves.iter().map(|m| (m.line, m.piece)).collect::<Vec<_>>(), [(9, line)]);
        assert_eq!(
            read(include_str!("../../../examples/linuxcnc/deep_hole.ngc")).unwrap()[0].piece.to,
            [1_000_000, 0, 0]
        );
        let ends = |program: &str| read(program).unwrap().iter().map(|m| m.piece.to).collect::<Vec<_>>();
        assert_eq!(ends("M5\nG1 Z-1\nG4 P1\nX1\nM5"), [[1_000_000, 0, 0], [1_000_000, 1_000_000, 0]], "no M3");
        assert_eq!(
            ends("G0 X1 Z2\nX0\nM3 S1 G1 Z-1\nM5 G0 Z3\nZ-1\nM3 S1\nX1\nM2"),
            [[1_000_000, 0, 0], [1_000_000, 1_000_000, 0]]
        );
    }

    #[test]
    fn a_feed_holds_from_its_line_on_for_everything_but_a_rapid() {
        let found = read("G1 X1\nG1 X2 F6\nX3\nG0 X4\nG20 F6 G1 X0\nF.012 G21\nX1").unwrap();
        let feeds: Vec<Option<f64>> = found.iter().map(|m| m.feed).collect();
        assert_eq!(feeds, [None, Some(100.0), Some(100.0), None, Some(2540.0), Some(0.2)]);
    }

    #[test]
    fn the_last_line_is_carried_out_to_its_end() {
        assert_eq!(read("G1 X1 M2\nG1 X2").unwrap().len(), 1);
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_word() {
        for (program, says) in [
            ("G1 X1\nG5 X2", "line 2: G5: must be one of"),
            ("G1 X1 Q2", "line 1: Q2: must be one of"),
            ("G1 X1\nG1.5 X2", "line 2: G1.5: must be one of"),
            ("\nX1", "line 2: X1: no G0 to G3"),
            ("G1 X1 X2", "line 1: X2: X is twice"),
            ("G2 X1 K1", "line 1: K1: an arc in G17 has its centre in I and J"),
            ("G3 X1", "line 1: G3: an arc in G17"),
            ("G1 X1 I1", "line 1: I1: only an arc"),
            ("G1 X1 R1", "line 1: R1: only an arc"),
            ("G2 X1 R1 J1", "line 1: J1: an arc with R"),
            ("G2 X0 Y0 R1", "line 1: R1: an arc with R must not end where it begins"),
            ("G2 X2.003 R1", "line 1: R1: its ends are 2.003 mm apart"),
            ("G2 X1 R0", "line 1: R0: its ends are 1.000 mm apart"),
            ("G2 X1 R3000", "line 1: R3000: the centre is farther"),
            ("G1 X1\nG90 G91 X1", "line 2: G91: G90 is in the same line"),
            ("G0 G1 X1", "line 1: G1: G0 is in the same line"),
            ("G17 G1 X1 G18", "line 1: G18: G17 is in the same line"),
            ("G20 G21", "line 1: G21: G20 is in the same line"),
            ("G1 G1 X1", "line 1: G1: G1 is in the same line"),
            ("G1 X1 F0", "line 1: F0: a feed must be 0.006 or more"),
            ("G1 X1 F-5", "line 1: F-5: a feed must be"),
            ("G20 G1 X1 F.0002", "line 1: F.0002: a feed must be 0.000237 or more"),
            ("G1 X1 F1 F2", "line 1: F2: F is twice"),
            ("G41 X1", "line 1: G41: must be one of"),
            ("M4 S100", "line 1: M4: must be one of"),
            ("G1 X1 S100", "line 1: S100: must be one of"),
            ("G1 X1 P1", "line 1: P1: must be one of"),
            ("G1 X1 G4 P1", "line 1: G4: G1 is in the same line"),
            ("G10 L2 P2 Z1", "line 1: G10: must be G10 L2 P1"),
            ("M3 M5", "line 1: M5: M3 is in the same line"),
            ("G0 X1\nM3 S1\nG1 Z-1", "line 2: M3: the head is at X0 Y0"),
            ("M3\nG1 Z-1\nM5\nG0 X1\nM3\nG1 Z-2", "line 5: M3: must be where M5 was"),
            ("G1 Z-1\nM3 S1\nM5", "no move"),
            ("G2 X1 I3000", "line 1: I3000: the centre is farther"),
            ("G1 Xnan", "line 1: Xnan: not a word"),
            ("G1 X1 hello", "line 1: hello: not a word"),
            ("G1 X1 (open", "line 1: (open: not a word"),
            ("G1 X1\nG1 X#5", "line 2: X#5: not a word"),
            ("G1 X1\nG1 XY5", "line 2: XY5: not a word"),
            ("G1 X1*44", "line 1: X1*44: not a word"),
            ("G1 µX1", "line 1: ?X1: not a word"),
            ("(nothing)\nM2", "no move"),
        ] {
            let error = read(program).map(|moves| format!("{moves:?}")).unwrap_or_else(|error| error);
            assert!(error.starts_with(says), "{program:?}: {error}");
        }
    }
}
