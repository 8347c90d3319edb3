//! A small part of G-code as pieces of path: G0, G1, G2, G3, G17 to G19, G20, G21, G90, G91, F, M2.
//!
//! Z is up, as on a machine; a head counts down. Z0 is the surface of the work, X0 Y0 where the head stands. G0 is gone along
//! like G1 and F is read and left alone: the gap decides how fast a path is eroded. `examples/gcode.py` accepts the same.

use edm_servo_head::path::{AXES, Piece, Plane, Shape, Turn};
use g_code::emit::Field;
use g_code::parse::ast::{Span, Spanned};
use g_code::parse::snippet_parser;

/// nm in a millimetre and in an inch.
const MM: f64 = 1e6;
const INCH: f64 = 25.4e6;

/// A piece of path, and where it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct Move {
    /// Line of the program, from 1.
    pub line: usize,
    /// The word that says most of where it leads: Z, or else another one.
    pub word: String,
    /// The piece, nm from X0 Y0 Z0.
    pub piece: Piece,
}

/// What holds until a line says otherwise.
struct Modal {
    /// Number of G0 to G3.
    motion: Option<u8>,
    plane: Plane,
    unit: f64,
    absolute: bool,
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
    let mut modal = Modal { motion: None, plane: Plane::Xy, unit: MM, absolute: true };
    let mut at = [0; AXES];
    let mut moves = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let number = number + 1;
        let told = |what: String| format!("line {number}: {what}");
        // A percent sign stands around a program and says nothing; in a comment there may be any letter.
        let plain = |c: char| match c {
            '%' => ' ',
            c if c.is_whitespace() => ' ',
            c if c.is_ascii_graphic() => c,
            _ => '?',
        };
        let ascii: String = line.chars().map(plain).collect();
        let words = words(&ascii).map_err(|wrong| told(format!("{wrong}: not a word of G-code")))?;
        let (piece, ends) = modal.carry_out(&words, at).map_err(told)?;
        if let Some((word, piece)) = piece {
            at = piece.to;
            moves.push(Move { line: number, word, piece });
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

impl Modal {
    /// Takes the words of a line: the piece that they make from a point, and whether the program ends.
    fn carry_out(&mut self, words: &[Word<'_>], at: [i64; AXES]) -> Result<(Option<(String, Piece)>, bool), String> {
        let mut given: Vec<(char, &Word<'_>)> = Vec::new();
        let mut ends = false;
        for word in words {
            let Word { letter, number, text } = word;
            match (letter, number) {
                ('G', 0.0..=3.0) if number.fract() == 0.0 => self.motion = Some(*number as u8),
                ('G', 17.0) => self.plane = Plane::Xy,
                ('G', 18.0) => self.plane = Plane::Zx,
                ('G', 19.0) => self.plane = Plane::Yz,
                ('G', 20.0) => self.unit = INCH,
                ('G', 21.0) => self.unit = MM,
                ('G', 90.0) => self.absolute = true,
                ('G', 91.0) => self.absolute = false,
                ('M', 2.0) => ends = true,
                ('F', _) => {}
                ('X' | 'Y' | 'Z' | 'I' | 'J' | 'K', _) if given.iter().any(|(other, _)| other == letter) => {
                    return Err(format!("{text}: {letter} stands twice in the line"));
                }
                ('X' | 'Y' | 'Z' | 'I' | 'J' | 'K', _) => given.push((*letter, word)),
                _ => return Err(format!("{text}: is not among G0 to G3, G17 to G21, G90, G91, F, M2")),
            }
        }
        let length = |letter: char| {
            given.iter().find(|(other, _)| *other == letter).map(|(_, word)| (word.number * self.unit).round() as i64)
        };
        let spelled =
            |letters: &str| given.iter().find(|(letter, _)| letters.contains(*letter)).map(|(_, word)| word.text);
        let Some(word) = spelled("Z").or(spelled("XY")).or(spelled("IJK")) else { return Ok((None, ends)) };
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
            if let Some(word) = spelled("IJK") {
                return Err(format!("{word}: only an arc has a centre"));
            }
            return Ok(((to != at).then(|| (word.into(), piece)), ends));
        }
        // Down is Z turned around, and so is the way round in its planes.
        let (name, centre, other) = match self.plane {
            Plane::Xy => ("G17 has its centre in I and J", [('I', 1), ('J', 1)], "K"),
            Plane::Zx => ("G18 has its centre in I and K", [('K', -1), ('I', 1)], "J"),
            Plane::Yz => ("G19 has its centre in J and K", [('J', 1), ('K', -1)], "I"),
        };
        let wrong = spelled(other).map(str::to_owned);
        let missing = centre.iter().all(|(letter, _)| length(*letter).is_none()).then(|| format!("G{motion}"));
        if let Some(word) = wrong.or(missing) {
            return Err(format!("{word}: an arc in {name}"));
        }
        for (nm, (letter, sign)) in piece.centre.iter_mut().zip(centre) {
            let far = |_| {
                format!(
                    "{}: a centre farther away than an arc may be wide",
                    spelled(&letter.to_string()).unwrap_or(word)
                )
            };
            *nm = i32::try_from(sign * length(letter).unwrap_or(0)).map_err(far)?;
        }
        let turn = if (motion == 3) == (self.plane == Plane::Xy) { Turn::Forward } else { Turn::Backward };
        piece.shape = Shape::of(self.plane, turn);
        Ok((Some((word.into(), piece)), ends))
    }
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
    fn the_last_line_is_carried_out_to_its_end() {
        assert_eq!(read("G1 X1 M2\nG1 X2").unwrap().len(), 1);
    }

    #[test]
    fn what_is_wrong_is_named_with_line_and_word() {
        for (program, says) in [
            ("G1 X1\nG5 X2", "line 2: G5: is not among"),
            ("G1 X1 Q2", "line 1: Q2: is not among"),
            ("G1 X1\nG1.5 X2", "line 2: G1.5: is not among"),
            ("\nX1", "line 2: X1: no G0 to G3"),
            ("G1 X1 X2", "line 1: X2: X stands twice"),
            ("G2 X1 K1", "line 1: K1: an arc in G17 has its centre in I and J"),
            ("G3 X1", "line 1: G3: an arc in G17"),
            ("G1 X1 I1", "line 1: I1: only an arc"),
            ("G2 X1 I3000", "line 1: I3000: a centre farther"),
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
