//! Photometric files of lamps (IES LM-63-2002), read as Cycles reads them.

use std::f32::consts::PI;
use std::sync::Arc;

/// Watts of a lamp's strength for a candela: 4 pi over the luminous efficacy of D65, 177.83 lm/W (Cycles, `util/ies.cpp`).
const STRENGTH_PER_CANDELA: f64 = 0.070_665_076_8;
/// Strength in all directions that Cycles gives a file that it cannot read.
const OF_BAD_FILE: f32 = 100.0;
/// Most angles of either kind, and most values.
const MOST_ANGLES: usize = 1 << 12;
const MOST_VALUES: usize = 1 << 20;
/// Largest strength: sums of some of them are finite.
const MOST_STRENGTH: f32 = 1e30;
/// Angle in radians below which a table begins at the pole.
const AT_POLE: f32 = 1e-7;

/// Strength of a lamp by direction, from the text of a photometric file.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(from = "IesSource", into = "IesSource")]
pub struct IesProfile {
    source: IesSource,
    table: Result<Arc<Table>, IesError>,
}

/// Text of a photometric file, and how the table in it is continued.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct IesSource {
    /// Text of the file.
    pub text: String,
    /// Continuation beyond the first and last angles, for the cubic interpolation between the last two.
    pub border: IesBorder,
}

/// Values beyond the angles of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IesBorder {
    /// Zero, as in Blender before 5.0.
    Zero,
    /// One of the two values that are interpolated, as since Blender 5.0.
    Nearest,
}

/// Fault of a photometric file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("IES file: {0}")]
pub struct IesError(String);

/// Strengths on a grid of angles, radians from the lamp's -z and about its z axis.
#[derive(Clone, Debug, PartialEq)]
struct Table {
    vertical: Vec<f32>,
    horizontal: Vec<f32>,
    /// A row of vertical angles for each horizontal one.
    strengths: Vec<Vec<f32>>,
}

impl From<IesSource> for IesProfile {
    fn from(source: IesSource) -> Self {
        let table = read(&source.text).map(Arc::new);
        Self { source, table }
    }
}

impl From<IesProfile> for IesSource {
    fn from(profile: IesProfile) -> Self {
        profile.source
    }
}

impl IesProfile {
    /// Fault of the file, which then counts as the same strength in all directions.
    pub fn fault(&self) -> Option<&IesError> {
        self.table.as_ref().err()
    }

    /// Strength towards a direction of the lamp's object space, of any length.
    pub fn strength(&self, direction: glam::Vec3) -> f32 {
        let Ok(table) = &self.table else { return OF_BAD_FILE };
        let unit = direction.normalize_or_zero();
        let vertical = (-unit.z).clamp(-1.0, 1.0).acos();
        table.at(unit.x.atan2(unit.y) + PI, vertical, self.source.border)
    }
}

impl Table {
    fn at(&self, horizontal: f32, vertical: f32, border: IesBorder) -> f32 {
        let (Some(h), Some(v)) =
            (Place::new(&self.horizontal, horizontal), Place::new(&self.vertical, vertical))
        else {
            return 0.0;
        };
        let of_row = |row: usize| self.along(row, &v, border);
        let [b, c] = [of_row(h.index), of_row(h.index + 1)];
        let outside = if border == IesBorder::Nearest { b } else { 0.0 };
        // Cycles would go on across a full turn, but never takes 360 degrees for one, which it compares after rounding.
        let a = h.index.checked_sub(1).map_or(outside, of_row);
        let d = if h.index + 2 < self.horizontal.len() { of_row(h.index + 2) } else { outside };
        cubic([a, b, c, d], h.share).max(0.0)
    }

    /// Interpolation in one row. Beyond the first pole the light counts as symmetrical.
    fn along(&self, row: usize, place: &Place, border: IesBorder) -> f32 {
        let (row, angles) = (&self.strengths[row], &self.vertical);
        let [b, c] = [row[place.index], row[place.index + 1]];
        let outside = |nearest: f32| if border == IesBorder::Nearest { nearest } else { 0.0 };
        let a = match place.index.checked_sub(1) {
            Some(before) => row[before],
            None if angles[0] < AT_POLE => row[1],
            None => outside(b),
        };
        // Likewise, it never takes 180 degrees for the pole.
        let d = row.get(place.index + 2).copied().unwrap_or_else(|| outside(c));
        cubic([a, b, c, d], place.share)
    }
}

/// Place between two angles of a list.
struct Place {
    index: usize,
    share: f32,
}

impl Place {
    /// The place of an angle; none outside of the list, whose end is outside.
    fn new(angles: &[f32], angle: f32) -> Option<Self> {
        if !(angle >= angles[0] && angle < angles[angles.len() - 1]) {
            return None;
        }
        let index = angles[1..].partition_point(|next| *next < angle);
        Some(Self { index, share: (angle - angles[index]) / (angles[index + 1] - angles[index]) })
    }
}

/// Catmull-Rom spline between the middle two of four values.
fn cubic([a, b, c, d]: [f32; 4], x: f32) -> f32 {
    let third = d - a + 3.0 * (b - c);
    let second = 2.0 * a - 5.0 * b + 4.0 * c - d;
    b + 0.5 * x * (c - a + x * (second + x * third))
}

/// Degrees and candelas of a file, still in its own coordinates.
struct Photometry {
    vertical: Vec<f32>,
    horizontal: Vec<f32>,
    strengths: Vec<Vec<f32>>,
}

fn read(text: &str) -> Result<Table, IesError> {
    let (kind, photometry) = parse(text)?;
    let turned = match kind {
        1 => photometry.of_type_c(),
        2 => photometry.of_type_b(),
        3 => Ok(photometry.of_type_a()),
        _ => Err(fault("its photometric type is none of 1, 2 and 3")),
    }?;
    turned.into_table()
}

fn parse(text: &str) -> Result<(i64, Photometry), IesError> {
    let tilt = text.find("\nTILT=").ok_or_else(|| fault("it has no line that begins with TILT="))? + 1;
    let line_end = text[tilt..].find('\n').ok_or_else(|| fault("it ends after its TILT line"))? + tilt;
    let mut numbers =
        Numbers(text[line_end..].split(|c: char| c.is_whitespace() || c == ',').filter(is_word));
    if text[tilt..line_end].trim_end() == "TILT=INCLUDE" {
        numbers.next("the geometry of its tilt")?;
        let count = numbers.count("the number of tilt angles")?;
        for _ in 0..2 * count {
            numbers.next("its tilt")?;
        }
    }
    numbers.next("the number of lamps")?;
    numbers.next("the lumens of a lamp")?;
    let multiplier = numbers.next("the candela multiplier")?;
    let vertical_count = numbers.count("the number of vertical angles")?;
    let horizontal_count = numbers.count("the number of horizontal angles")?;
    if vertical_count < 2 || horizontal_count < 1 || vertical_count * horizontal_count > MOST_VALUES {
        return Err(fault("it has too few or too many angles"));
    }
    let kind = numbers.next("the photometric type")? as i64;
    for what in ["the unit of its size", "its width", "its length", "its height"] {
        numbers.next(what)?;
    }
    let factor =
        multiplier * numbers.next("the ballast factor")? * numbers.next("the ballast-lamp factor")?;
    numbers.next("its watts")?;
    let factor = factor * STRENGTH_PER_CANDELA;
    let vertical = numbers.list(vertical_count, 1.0, "its vertical angles")?;
    let horizontal = numbers.list(horizontal_count, 1.0, "its horizontal angles")?;
    let row = |_| numbers.list(vertical_count, factor, "its candela values");
    let strengths = (0..horizontal_count).map(row).collect::<Result<_, _>>()?;
    Ok((kind, Photometry { vertical, horizontal, strengths }))
}

fn is_word(word: &&str) -> bool {
    !word.is_empty()
}

fn fault(reason: &str) -> IesError {
    IesError(reason.to_owned())
}

/// Numbers of a file, one after the other.
struct Numbers<I>(I);

impl<'a, I: Iterator<Item = &'a str>> Numbers<I> {
    fn next(&mut self, what: &str) -> Result<f64, IesError> {
        let word = self.0.next().ok_or_else(|| IesError(format!("it ends before {what}")))?;
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| IesError(format!("'{}' is no number, for {what}", head(word))))
    }

    fn count(&mut self, what: &str) -> Result<usize, IesError> {
        let number = self.next(what)?;
        let is_count = number.fract() == 0.0 && (0.0..=MOST_ANGLES as f64).contains(&number);
        if is_count { Ok(number as usize) } else { Err(IesError(format!("{what} is {number}"))) }
    }

    fn list(&mut self, count: usize, factor: f64, what: &str) -> Result<Vec<f32>, IesError> {
        (0..count).map(|_| self.next(what).map(|number| (number * factor) as f32)).collect()
    }
}

/// Beginning of a word, for messages.
fn head(word: &str) -> String {
    word.chars().take(20).collect()
}

impl Photometry {
    /// Vertical angles from the lamp's axis, horizontal ones all around.
    fn of_type_c(mut self) -> Result<Self, IesError> {
        if self.horizontal[0] == 90.0 {
            self.horizontal.iter_mut().for_each(|angle| *angle -= 90.0);
        }
        if self.horizontal[0] != 0.0 {
            return Err(fault("its horizontal angles begin neither at 0 nor at 90"));
        }
        if self.horizontal.len() == 1 {
            self.append(360.0, 0);
        }
        for end in [90.0, 180.0] {
            if self.last_horizontal() == end {
                for row in (0..self.horizontal.len() - 1).rev() {
                    self.append(2.0 * end - self.horizontal[row], row);
                }
            }
        }
        let (last, count) = (self.last_horizontal(), self.horizontal.len());
        let gap = 360.0 - last;
        // Some files leave out the last angle, which is the first again.
        if gap != 0.0
            && (last - self.horizontal[count - 2] == gap || self.horizontal[1] - self.horizontal[0] == gap)
        {
            self.append(360.0, 0);
        }
        Ok(self)
    }

    /// Angles about a horizontal axis, which become vertical ones, and from the plane through it.
    fn of_type_b(mut self) -> Result<Self, IesError> {
        let columns = 0..self.vertical.len();
        self.strengths = columns.map(|i| self.strengths.iter().map(|row| row[i]).collect()).collect();
        std::mem::swap(&mut self.vertical, &mut self.horizontal);
        if self.vertical.len() < 2
            || self.last_horizontal() != 90.0
            || self.vertical[self.vertical.len() - 1] != 90.0
        {
            return Err(fault("its angles of type B do not end at 90"));
        }
        if self.horizontal[0] == 0.0 {
            let below: Vec<_> = self.horizontal[1..].iter().rev().map(|angle| -angle).collect();
            let rows: Vec<_> = self.strengths[1..].iter().rev().cloned().collect();
            self.horizontal.splice(0..0, below);
            self.strengths.splice(0..0, rows);
        }
        self.horizontal.iter_mut().for_each(|angle| *angle += 90.0);
        if self.vertical[0] == 0.0 {
            let below: Vec<_> = self.vertical[1..].iter().rev().map(|angle| -angle).collect();
            self.vertical.splice(0..0, below);
            for row in &mut self.strengths {
                let mirrored: Vec<_> = row[1..].iter().rev().copied().collect();
                row.splice(0..0, mirrored);
            }
        }
        self.vertical.iter_mut().for_each(|angle| *angle += 90.0);
        Ok(self)
    }

    /// Angles from the horizon and from straight ahead.
    fn of_type_a(mut self) -> Self {
        self.vertical.iter_mut().for_each(|angle| *angle += 90.0);
        let ahead = self.horizontal.clone();
        self.horizontal = ahead.iter().rev().map(|angle| 180.0 - angle).collect();
        self.strengths.reverse();
        if ahead[0] == 0.0 {
            let rows = self.strengths.len();
            for (number, angle) in ahead.iter().enumerate().skip(1) {
                self.append(180.0 + angle, rows - 1 - number);
            }
        }
        self
    }

    fn last_horizontal(&self) -> f32 {
        self.horizontal[self.horizontal.len() - 1]
    }

    /// Adds a horizontal angle with the values of a row.
    fn append(&mut self, angle: f32, row: usize) {
        self.horizontal.push(angle);
        self.strengths.push(self.strengths[row].clone());
    }

    fn into_table(self) -> Result<Table, IesError> {
        let radians = |angles: Vec<f32>| angles.into_iter().map(f32::to_radians).collect::<Vec<_>>();
        let (vertical, horizontal) = (radians(self.vertical), radians(self.horizontal));
        let rises = |angles: &[f32]| angles.len() >= 2 && angles.is_sorted_by(|a, b| a < b);
        if !rises(&vertical) || !rises(&horizontal) {
            return Err(fault("its angles do not rise"));
        }
        let is_sound = |value: &f32| value.abs() <= MOST_STRENGTH;
        if !self.strengths.iter().flatten().all(is_sound) {
            return Err(fault("a value of it is too large"));
        }
        Ok(Table { vertical, horizontal, strengths: self.strengths })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn file(kind: u8, vertical: &[f32], horizontal: &[f32], candela: &[f32]) -> String {
        let words = |numbers: &[f32]| numbers.iter().map(f32::to_string).collect::<Vec<_>>().join(" ");
        format!(
            "IESNA:LM-63-1995\n[TEST]\nTILT=NONE\n1 1000 1 {} {} {kind} 2 0 0 0\n1 1 10\n{}\n{}\n{}\n",
            vertical.len(),
            horizontal.len(),
            words(vertical),
            words(horizontal),
            words(candela)
        )
    }

    fn profile(text: &str, border: IesBorder) -> IesProfile {
        IesSource { text: text.into(), border }.into()
    }

    fn candela(profile: &IesProfile, direction: Vec3) -> f32 {
        profile.strength(direction) / STRENGTH_PER_CANDELA as f32
    }

    #[test]
    fn one_plane_is_turned_all_around() {
        let text = file(1, &[0.0, 45.0, 90.0], &[0.0], &[100.0, 50.0, 20.0]);
        let found = profile(&text, IesBorder::Nearest);
        assert!(found.fault().is_none());
        assert!((candela(&found, Vec3::NEG_Z) - 100.0).abs() < 1e-3);
        for turn in [0.1_f32, 2.0, 4.0] {
            let aside = Vec3::new(turn.cos(), turn.sin(), -1.0);
            assert!((candela(&found, aside) - 50.0).abs() < 1e-2, "{turn}");
        }
        assert_eq!(candela(&found, Vec3::Z), 0.0, "outside of the file's angles");
    }

    #[test]
    fn a_constant_table_swells_at_its_border_before_blender_5() {
        let text = file(1, &[0.0, 45.0, 90.0], &[0.0], &[100.0; 3]);
        // Half way between the last two vertical angles, and of a plane and itself.
        let aside = Vec3::new(0.0, 67.5_f32.to_radians().tan(), -1.0);
        // In the middle of two, a Catmull-Rom spline weighs each value beyond by -1/16.
        let wanted = 100.0 * (1.0 + 1.0 / 16.0) * (1.0 + 2.0 / 16.0);
        assert!((candela(&profile(&text, IesBorder::Zero), aside) - wanted).abs() < 0.01);
        assert!((candela(&profile(&text, IesBorder::Nearest), aside) - 100.0).abs() < 0.01);
    }

    #[test]
    fn a_quadrant_is_mirrored_twice() {
        let text = file(1, &[0.0, 90.0], &[0.0, 90.0], &[10.0, 10.0, 30.0, 30.0]);
        let found = profile(&text, IesBorder::Nearest);
        // Not at the very end of a full turn, which is outside.
        let down = |x: f32, y: f32| candela(&found, Vec3::new(x + 1e-4, y, -1.0));
        for (x, y, wanted) in [(0.0, 1.0, 10.0), (0.0, -1.0, 10.0), (1.0, 0.0, 30.0), (-1.0, 0.0, 30.0)] {
            assert!((down(x, y) - wanted).abs() < 0.01, "{x} {y}: {}", down(x, y));
        }
    }

    #[test]
    fn what_is_no_file_of_a_lamp_shines_as_in_cycles_and_is_named() {
        let good = file(1, &[0.0, 90.0], &[0.0], &[1.0, 1.0]);
        let endless = good.replace("1 1000 1 2 1 1", "1 1000 1 2000000000 1 1");
        for text in
            ["", "TILT=NONE", "x\nTILT=NONE\n", &good[..good.len() - 4], &endless, &good.replace("90", "x")]
        {
            let found = profile(text, IesBorder::Zero);
            assert!(found.fault().is_some(), "{text}");
            assert_eq!(found.strength(Vec3::X), 100.0);
        }
    }

    #[test]
    fn tilt_is_passed_over_and_commas_part_numbers() {
        let plain = file(1, &[0.0, 90.0], &[0.0], &[7.0, 7.0]);
        let tilted = plain.replace("TILT=NONE\n", "TILT=INCLUDE\r\n1\n2\n0 90\n1.0,0.9\n");
        let found = profile(&tilted, IesBorder::Nearest);
        assert!((candela(&found, Vec3::NEG_Z) - 7.0).abs() < 1e-4, "{:?}", found.fault());
    }
}
