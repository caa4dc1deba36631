//! The space between charts, beyond the padding: filled so that no level of a mip pyramid mixes black into a chart's light.
//!
//! Push and pull (Gortler, Grzeszczuk, Szeliski, Cohen 1996, "The Lumigraph", section 3.4): filled texels are averaged into ever coarser
//! levels, and what is empty takes the value of the next coarser level, read bilinearly. Cost: linear in the texels.

use crate::color::Rgb;
use rayon::prelude::*;

/// What the texels that no chart or padding covers hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Gutter {
    /// Light of the charts around, ever smoother with the distance.
    #[default]
    All,
    /// Nothing: black beyond the padding.
    Padding,
}

/// A level: colours, and whether there is one.
struct Level {
    size: [usize; 2],
    rgb: Vec<Rgb>,
    filled: Vec<bool>,
}

/// Fills the texels of a page of `size` that are not `filled` yet; nothing where none is.
pub fn push_pull(size: [usize; 2], rgb: &mut [Rgb], filled: &[bool]) {
    if !filled.contains(&true) || !filled.contains(&false) {
        return;
    }
    let mut levels = vec![halve(size, rgb, filled)];
    while levels.last().is_some_and(|level| level.filled.contains(&false)) {
        let Level { size, rgb, filled } = &levels[levels.len() - 1];
        levels.push(halve(*size, rgb, filled));
    }
    while let Some(coarse) = levels.pop() {
        match levels.last_mut() {
            Some(fine) => pull(fine.size, &mut fine.rgb, &fine.filled, &coarse),
            None => pull(size, rgb, filled, &coarse),
        }
    }
}

/// The level above: means of the filled ones of four texels.
fn halve(size: [usize; 2], rgb: &[Rgb], filled: &[bool]) -> Level {
    let half = size.map(|n| n.div_ceil(2));
    let mean = |t: usize| {
        let (x, y) = (2 * (t % half[0]), 2 * (t / half[0]));
        let (mut sum, mut count) = (Rgb::ZERO, 0.0);
        for v in y..(y + 2).min(size[1]) {
            for u in x..(x + 2).min(size[0]) {
                if filled[v * size[0] + u] {
                    sum += rgb[v * size[0] + u];
                    count += 1.0;
                }
            }
        }
        (sum / f32::max(count, 1.0), count > 0.0)
    };
    let (rgb, filled) = (0..half[0] * half[1]).into_par_iter().map(mean).unzip();
    Level { size: half, rgb, filled }
}

/// Gives what is empty the value of the level above, between its four nearest texels.
fn pull(size: [usize; 2], rgb: &mut [Rgb], filled: &[bool], coarse: &Level) {
    let value = |t: usize| {
        let at = |n: usize, most: usize| {
            // Nine parts of the nearer, three of the further: 3/4 and 1/4 along each axis.
            let near = n / 2;
            (near, if n.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(most - 1) })
        };
        let (x, y) = (at(t % size[0], coarse.size[0]), at(t / size[0], coarse.size[1]));
        let read = |x: usize, y: usize| coarse.rgb[y * coarse.size[0] + x];
        (read(x.0, y.0) * 9.0 + (read(x.1, y.0) + read(x.0, y.1)) * 3.0 + read(x.1, y.1)) / 16.0
    };
    rgb.par_iter_mut().enumerate().filter(|(t, _)| !filled[*t]).for_each(|(t, rgb)| *rgb = value(t));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_filled_stays_and_the_rest_lies_between() {
        let size = [13, 7];
        let mut rgb = vec![Rgb::ZERO; 91];
        let mut filled = vec![false; 91];
        for (t, v) in [(0, 1.0), (12, 3.0), (80, 2.0)] {
            (rgb[t], filled[t]) = (Rgb::splat(v), true);
        }
        push_pull(size, &mut rgb, &filled);
        assert_eq!([rgb[0].x, rgb[12].x, rgb[80].x], [1.0, 3.0, 2.0]);
        assert!(rgb.iter().all(|v| (1.0..=3.0).contains(&v.x)));
        assert!(rgb[1].x < 1.5 && rgb[11].x > 2.5, "{} {}", rgb[1].x, rgb[11].x);
    }

    #[test]
    fn one_value_is_everywhere_and_none_is_nowhere() {
        let (mut rgb, mut filled) = (vec![Rgb::ZERO; 64], vec![false; 64]);
        push_pull([8, 8], &mut rgb, &filled);
        assert!(rgb.iter().all(|v| *v == Rgb::ZERO));
        (rgb[27], filled[27]) = (Rgb::splat(0.7), true);
        push_pull([8, 8], &mut rgb, &filled);
        assert!(rgb.iter().all(|v| (v.x - 0.7).abs() < 1e-6));
    }
}
