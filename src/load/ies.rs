//! IES LM-63 files to photometric webs: the editions of 1986, 1991, 1995, 2002 and 2019, photometric types A, B and C.
//!
//! Layout (ANSI/IES LM-63-19, section 5): lines of labels or keywords; `TILT=`; then numbers, parted by blanks, commas and line
//! ends: lamps, lumens per lamp (-1 for absolute photometry), candela multiplier, counts of vertical and horizontal angles, type,
//! units, width, length, height; ballast factor, ballast-lamp factor, watts; the vertical angles, the horizontal angles, and the
//! candelas by horizontal angle. The first edition has no first line that tells its name, and none is needed.
//!
//! Symmetries are unfolded: type C that is round, or measured over a quadrant or a half (0 to 180 or 90 to 270 degrees); types A
//! and B measured to one side, or upwards alone. Limits: `TILT=<file>` is not read, with a warning.

use crate::error::{Error, Result, Warnings};
use crate::scene::PhotometricWeb;
use crate::scene::web::WebKind;

/// Largest file that is read [bytes].
pub const MAX_BYTES: usize = 16 << 20;
/// Most angles of a kind, and candelas in all.
const MAX_ANGLES: usize = 1 << 14;
const MAX_CANDELAS: usize = 1 << 22;

/// How far an angle may be off and still count as the one that a symmetry asks for [degrees].
const CLOSE: f32 = 1e-2;

/// Least step from one angle to the next [degrees]: files give hundredths, and less is lost in rounding to radians.
const LEAST_STEP: f32 = 1e-4;

/// True where angles [degrees] ascend by steps that can be told apart.
fn ascend(angles: &[f32]) -> bool {
    angles.windows(2).all(|pair| pair[1] - pair[0] >= LEAST_STEP)
}

/// Reads the LM-63 file `bytes`; `name` is for messages.
///
/// # Errors
/// `Invalid`, naming the file and what is wrong.
pub fn read(name: &str, bytes: &[u8], warnings: &mut Warnings) -> Result<PhotometricWeb> {
    let broken = |message: &str| Error::invalid(name, format!("{message}; get the photometric file again"));
    if bytes.len() > MAX_BYTES {
        return Err(broken("is too large for an IES profile"));
    }
    // Old files are in whatever code page their labels needed; the numbers are ASCII in all of them.
    let text = String::from_utf8_lossy(bytes);
    let (head, rest) = tilt_line(&text).ok_or_else(|| broken("has no line TILT=, so it is no IES profile"))?;
    let mut numbers = Numbers { rest };
    let mut next = |what: &str| numbers.next().ok_or_else(|| broken(&format!("{what} is missing or no number")));
    let tilt = match head {
        "NONE" => Vec::new(),
        "INCLUDE" => tilt(&mut next, &broken)?,
        file => {
            warnings.add(
                format!("{name}: {file}"),
                "a tilt file of an IES profile is not read; the lamp counts as untilted",
            );
            Vec::new()
        }
    };
    let (lamps, lumens, multiplier) =
        (next("the number of lamps")?, next("the lumens per lamp")?, next("the candela multiplier")?);
    let angles = |n: f32| count(n, MAX_ANGLES).filter(|n| *n > 0);
    let rows = angles(next("the number of vertical angles")?);
    let columns = angles(next("the number of horizontal angles")?);
    let (rows, columns) = rows.zip(columns).ok_or_else(|| broken("its numbers of angles are out of range"))?;
    let kind = match next("the photometric type")? {
        1.0 => WebKind::C,
        2.0 => WebKind::B,
        3.0 => WebKind::A,
        _ => return Err(broken("its photometric type is none of 1, 2, 3")),
    };
    // Units and sizes of the luminaire: a bake takes the shape from the light.
    for what in ["the units", "the width", "the length", "the height"] {
        next(what)?;
    }
    let factor = multiplier * next("the ballast factor")? * next("the ballast-lamp factor")?;
    next("the watts")?;
    let total = rows.checked_mul(columns).filter(|n| *n <= MAX_CANDELAS);
    let total = total.ok_or_else(|| broken("has more intensities than can be read"))?;
    let vertical = (0..rows).map(|_| next("a vertical angle")).collect::<Result<Vec<f32>>>()?;
    let horizontal = (0..columns).map(|_| next("a horizontal angle")).collect::<Result<Vec<f32>>>()?;
    if !ascend(&vertical) || !ascend(&horizontal) {
        return Err(broken("its angles don't ascend"));
    }
    let candela =
        (0..total).map(|_| next("an intensity").map(|c| (c * factor).max(0.0))).collect::<Result<Vec<f32>>>()?;
    if candela.iter().any(|c| !c.is_finite()) {
        return Err(broken("its intensities are out of range"));
    }
    let grid = Grid { vertical, horizontal, candela };
    let grid = if kind == WebKind::C { grid.unfold_turn() } else { grid.unfold_sides() }.map_err(broken)?;
    let radians = |angles: Vec<f32>| angles.into_iter().map(f32::to_radians).collect();
    let rated = f64::from(lamps) * f64::from(lumens);
    Ok(PhotometricWeb {
        name: name.to_owned(),
        kind,
        vertical: radians(grid.vertical),
        horizontal: radians(grid.horizontal),
        candela: grid.candela,
        rated_lumens: (lumens > 0.0 && lamps > 0.0).then_some(rated),
        tilt,
    })
}

/// The factors of a tilted lamp, by angle [rad]; `next` reads a number and `broken` says what is wrong.
fn tilt(next: &mut dyn FnMut(&str) -> Result<f32>, broken: &dyn Fn(&str) -> Error) -> Result<Vec<[f32; 2]>> {
    // Whether the lamp stands or lies; the factors hold for either.
    next("the lamp's position")?;
    let count = count(next("the number of tilt angles")?, MAX_ANGLES).ok_or_else(|| broken("has too many tilts"))?;
    let angles = (0..count).map(|_| next("a tilt angle")).collect::<Result<Vec<f32>>>()?;
    let factors = (0..count).map(|_| next("a tilt factor")).collect::<Result<Vec<f32>>>()?;
    if !ascend(&angles) {
        return Err(broken("its tilt angles don't ascend"));
    }
    Ok(angles.into_iter().map(f32::to_radians).zip(factors).map(|(a, f)| [a, f.max(0.0)]).collect())
}

/// What follows `TILT=` on its line, and the text after that line.
fn tilt_line(text: &str) -> Option<(&str, &str)> {
    let mut at = 0;
    for line in text.split_inclusive(['\n', '\r']) {
        at += line.len();
        if let Some(tilt) = line.trim().strip_prefix("TILT=") {
            return Some((tilt.trim(), text.get(at..)?));
        }
    }
    None
}

/// A count that is whole and at most `most`.
fn count(n: f32, most: usize) -> Option<usize> {
    (n >= 0.0 && n.fract() == 0.0 && n <= most as f32).then_some(n as usize)
}

/// Numbers of a text, one after the other.
struct Numbers<'a> {
    rest: &'a str,
}

impl Iterator for Numbers<'_> {
    type Item = f32;

    /// `None` at the end, and where something else stands.
    fn next(&mut self) -> Option<f32> {
        let is_gap = |c: char| c.is_whitespace() || c == ',';
        let text = self.rest.trim_start_matches(is_gap);
        let (word, rest) = text.split_at(text.find(is_gap).unwrap_or(text.len()));
        self.rest = rest;
        word.parse().ok().filter(|v: &f32| v.is_finite())
    }
}

/// A grid of intensities as it is measured [degrees, cd].
struct Grid {
    vertical: Vec<f32>,
    horizontal: Vec<f32>,
    candela: Vec<f32>,
}

impl Grid {
    /// Type C: columns over a whole turn.
    fn unfold_turn(mut self) -> std::result::Result<Self, &'static str> {
        let (first, last) = self.ends();
        if first < -CLOSE
            || last > 360.0 + CLOSE
            || self.vertical[0] < -CLOSE
            || self.vertical.iter().any(|v| *v > 180.0 + CLOSE)
        {
            return Err("its angles lie outside of those of type C");
        }
        if self.horizontal.len() == 1 {
            let column = self.column(0).to_vec();
            self.horizontal = vec![0.0, 360.0];
            self.candela.extend(column);
            return Ok(self);
        }
        if is(first, 0.0) && is(last, 90.0) {
            self.mirror(90.0);
        }
        let (first, last) = self.ends();
        if is(last - first, 180.0) {
            self.mirror(last);
        } else if !is(last - first, 360.0) {
            // Some leave out the last column, which is the first one.
            let step = self.horizontal.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max);
            if !is(first, 0.0) || 360.0 - last > step + CLOSE {
                return Err("its horizontal angles are neither one, nor a quadrant, a half or a whole turn");
            }
            let column = self.column(0).to_vec();
            self.horizontal.push(360.0);
            self.candela.extend(column);
        }
        Ok(self)
    }

    /// Types A and B: both sides, and below as above, where one is measured.
    fn unfold_sides(mut self) -> std::result::Result<Self, &'static str> {
        if [&self.vertical, &self.horizontal].into_iter().flatten().any(|a| a.abs() > 90.0 + CLOSE) {
            return Err("its angles lie outside of those of types A and B");
        }
        let rows = self.vertical.len();
        if is(self.vertical[0], 0.0) && rows > 1 {
            self.candela =
                self.candela.chunks(rows).flat_map(|column| column[1..].iter().rev().chain(column).copied()).collect();
            self.vertical = mirrored_below(&self.vertical);
        }
        if is(self.horizontal[0], 0.0) && self.horizontal.len() > 1 {
            let rows = self.vertical.len();
            let columns: Vec<Vec<f32>> = self.candela.chunks(rows).map(<[f32]>::to_vec).collect();
            self.candela = columns[1..].iter().rev().chain(&columns).flatten().copied().collect();
            self.horizontal = mirrored_below(&self.horizontal);
        }
        if self.horizontal.len() == 1 {
            let column = self.column(0).to_vec();
            self.horizontal = vec![-90.0, 90.0];
            self.candela.extend(column);
        }
        Ok(self)
    }

    fn ends(&self) -> (f32, f32) {
        (self.horizontal[0], self.horizontal[self.horizontal.len() - 1])
    }

    fn column(&self, h: usize) -> &[f32] {
        &self.candela[h * self.vertical.len()..][..self.vertical.len()]
    }

    /// Adds the columns beyond `about`, the last angle, as they are before it.
    fn mirror(&mut self, about: f32) {
        for h in (0..self.horizontal.len() - 1).rev() {
            let column = self.column(h).to_vec();
            self.horizontal.push(2.0 * about - self.horizontal[h]);
            self.candela.extend(column);
        }
    }
}

/// Angles from 0 on, and their negatives before them.
fn mirrored_below(angles: &[f32]) -> Vec<f32> {
    angles[1..].iter().rev().map(|a| -a).chain(angles.iter().copied()).collect()
}

fn is(a: f32, b: f32) -> bool {
    (a - b).abs() <= CLOSE
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::f64::consts::PI;

    /// A file of type `kind` whose intensity is `candela` of (vertical, horizontal) degrees.
    fn file(kind: u8, vertical: &[f32], horizontal: &[f32], candela: impl Fn(f32, f32) -> f32) -> String {
        let list = |values: &[f32]| values.iter().map(f32::to_string).collect::<Vec<_>>().join(" ");
        let mut text = format!(
            "IES:LM-63-2019\n[TEST] made\nTILT=NONE\n1 -1 2.0 {} {} {kind} 2 0 0 0\n1.0 1.0 10\n{}\n{}\n",
            vertical.len(),
            horizontal.len(),
            list(vertical),
            list(horizontal)
        );
        for h in horizontal {
            let column: Vec<f32> = vertical.iter().map(|v| candela(*v, *h) / 2.0).collect();
            text += &(list(&column) + "\n");
        }
        text
    }

    fn steps(first: f32, last: f32, n: usize) -> Vec<f32> {
        (0..=n).map(|i| first + (last - first) * i as f32 / n as f32).collect()
    }

    fn web(text: &str) -> PhotometricWeb {
        read("lamp.ies", text.as_bytes(), &mut Warnings::default()).unwrap()
    }

    /// Power by a sum over directions, which knows nothing of the web's grid.
    fn sum(web: &PhotometricWeb) -> f64 {
        let n = 512;
        let mut sum = 0.0;
        for i in 0..n {
            let z = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
            for j in 0..n {
                let (sin, cos) = (std::f32::consts::TAU * (j as f32 + 0.5) / n as f32).sin_cos();
                let r = (1.0 - z * z).sqrt();
                sum += f64::from(web.intensity(Vec3::new(r * cos, r * sin, z)));
            }
        }
        sum * 4.0 * PI / f64::from(n * n)
    }

    #[test]
    fn powers_are_the_closed_forms() {
        let whole = |v: f32, _: f32| 100.0 * v.to_radians().cos().max(0.0);
        // A Lambertian lamp: pi I0, whatever part of the turn is measured.
        for horizontal in [vec![0.0], steps(0., 90., 4), steps(0., 180., 6), steps(90., 270., 6), steps(0., 360., 8)] {
            let web = web(&file(1, &steps(0., 90., 90), &horizontal, whole));
            assert!((web.power() / (100.0 * PI) - 1.0).abs() < 1e-3, "{horizontal:?}: {}", web.power());
            assert!((sum(&web) / web.power() - 1.0).abs() < 2e-3);
        }
        // The same lamp as types A and B have it: the beam's cosine is cos V cos H in both.
        let lambert = |v: f32, h: f32| 100.0 * v.to_radians().cos() * h.to_radians().cos();
        for kind in [2, 3] {
            for start in [0.0, -90.0] {
                let angles = steps(start, 90., if start < 0.0 { 120 } else { 60 });
                let web = web(&file(kind, &angles, &angles, lambert));
                assert!((web.power() / (100.0 * PI) - 1.0).abs() < 2e-3, "{kind} {start}: {}", web.power());
                assert!((sum(&web) / web.power() - 1.0).abs() < 2e-3);
            }
        }
        // A ball that shines alike to all sides: 4 pi I, and its mean is I; half a one has I over a hemisphere.
        let ball = web(&file(1, &steps(0., 180., 18), &[0.0], |_, _| 7.0));
        assert!((ball.power() / (28.0 * PI) - 1.0).abs() < 1e-6 && (ball.mean_intensity() - 7.0).abs() < 1e-5);
        let half = web(&file(1, &steps(0., 90., 18), &[0.0], |_, _| 7.0));
        assert!((half.power() / (14.0 * PI) - 1.0).abs() < 1e-6 && (half.mean_intensity() - 7.0).abs() < 1e-5);
    }

    #[test]
    fn directions_are_read_where_the_types_have_them() {
        // Type C: brightest at 45 degrees from the beam towards +Y.
        let c =
            web(&file(
                1,
                &steps(0., 180., 36),
                &steps(0., 360., 36),
                |v, h| if v == 45.0 && h == 90.0 { 1.0 } else { 0.0 },
            ));
        let d = Vec3::new(0.0, 0.5f32.sqrt(), 0.5f32.sqrt());
        assert!((c.intensity(d) - 1.0).abs() < 1e-4);
        assert_eq!(c.intensity(Vec3::new(d.x, -d.y, d.z)), 0.0);
        // Types A and B: 30 degrees up, 60 degrees to the right.
        let spot = |v: f32, h: f32| if v == 30.0 && h == 60.0 { 1.0 } else { 0.0 };
        let angles = steps(-90., 90., 36);
        let (up, right) = (30f32.to_radians().sin_cos(), 60f32.to_radians().sin_cos());
        let a = web(&file(3, &angles, &angles, spot));
        assert!((a.intensity(Vec3::new(up.1 * right.0, up.0, up.1 * right.1)) - 1.0).abs() < 1e-4);
        let b = web(&file(2, &angles, &angles, spot));
        assert!((b.intensity(Vec3::new(right.0, right.1 * up.0, right.1 * up.1)) - 1.0).abs() < 1e-4);
        // Measured on one side: the other is alike.
        let sides = web(&file(3, &steps(0., 90., 18), &steps(0., 90., 18), spot));
        for (x, y) in [(1.0, 1.0), (-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
            let d = Vec3::new(x * up.1 * right.0, y * up.0, up.1 * right.1);
            assert!((sides.intensity(d) - 1.0).abs() < 1e-4, "{x} {y}");
        }
        // A half from 90 to 270 degrees is mirrored about the plane of both.
        let half =
            web(&file(
                1,
                &steps(0., 180., 36),
                &steps(90., 270., 36),
                |v, h| if v == 90.0 && h == 120.0 { 1.0 } else { 0.0 },
            ));
        for x in [-1.0, 1.0] {
            let (sin, cos) = 120f32.to_radians().sin_cos();
            assert!((half.intensity(Vec3::new(x * cos, sin, 0.0)) - 1.0).abs() < 1e-3, "{x}");
        }
    }

    #[test]
    fn every_edition_and_tilt_is_read() {
        let numbers = "2 500 1 2 1 1 1 0 0 0\n1 1 20\n0 90\n0\n10, 10\n";
        for head in
            ["IESNA:LM-63-2002\nTILT=NONE", "A label\nTILT=NONE", "IESNA91\r\n[LAMP] x\r\nTILT=NONE\r", "TILT=NONE"]
        {
            let web = web(&format!("{head}\n{numbers}"));
            assert_eq!(web.rated_lumens, Some(1000.0));
            assert_eq!(web.candela, [10.0; 4]);
            assert_eq!(web.tilt_factor(1.0), 1.0);
        }
        let tilted = web(&format!("IESNA:LM-63-1995\nTILT=INCLUDE\n1\n3\n0 45 90\n1.0 0.8 0.4\n{numbers}"));
        assert!((tilted.tilt_factor(67.5f32.to_radians()) - 0.6).abs() < 1e-5);
        assert!((tilted.tilt_factor(3.0) - 0.4).abs() < 1e-6);
        let mut warnings = Warnings::default();
        assert!(read("a.ies", format!("TILT=lamp.tlt\n{numbers}").as_bytes(), &mut warnings).is_ok());
        assert!(!warnings.is_empty());
    }

    #[test]
    fn broken_files_are_refused() {
        let good = file(1, &[0.0, 90.0], &[0.0], |_, _| 1.0);
        for end in 0..good.len() - 3 {
            let cut = &good.as_bytes()[..end];
            if let Ok(web) = read("cut.ies", cut, &mut Warnings::default()) {
                assert!(web.power().is_finite());
            }
        }
        let refused = |text: &str| read("bad.ies", text.as_bytes(), &mut Warnings::default()).is_err();
        assert!(refused("no profile at all"));
        assert!(refused(&good.replace("TILT=NONE\n1 -1 2.0 2 1 1", "TILT=NONE\n1 -1 2.0 16000 16000 1")));
        assert!(
            refused(&good.replace("2.0 2 1 1", "2.0 1e30 1 1")) && refused(&good.replace("2.0 2 1 1", "2.0 0 1 1"))
        );
        assert!(refused(&good.replace("2.0 2 1 1", "2.0 2 1 4")) && refused(&good.replace("0 90\n", "90 0\n")));
        assert!(
            refused(&good.replace("0 90\n", "0 NaN\n"))
                && refused(&good.replace("2.0 2 1 1", "1e38 2 1 1").replace("1.0 1.0 10", "1e30 1.0 10"))
        );
        assert!(refused(&file(1, &[0.0, 90.0], &[0.0, 30.0, 60.0], |_, _| 1.0)));
        assert!(refused(&file(1, &[0.0, 200.0], &[0.0], |_, _| 1.0)));
    }
}
