//! What coarser texels would miss of the light of each chart.
//!
//! The light of a quick bake is averaged over squares of 2 x 2 and of 4 x 4 texels of a chart, read in between as an engine reads
//! texels, and compared with the texels themselves: what is missed at two sizes of texels, from which that at others follows
//! ([`super::allot`]). The errors of the two halves of the samples differ, what there is in the light does not: of r, what is missed
//! of their mean, and s, what is missed of half their difference, the product of both halves is r² - s², which noise adds
//! nothing to on average.
//!
//! As for the error of a whole bake, the worst hundredth of the area doesn't rule: it counts as much as the place where it
//! begins. That is mostly texels along sharp edges, whose area is as wide as they are: of coarser texels the same edges are a larger
//! share.

use super::allot::Need;
use crate::color::luminance;
use crate::illuminate::Illuminated;
use crate::scene::Scene;
use crate::unwrap::Atlas;
use rayon::prelude::*;

/// The share of the area that is worst, of texels of the bake's size.
const WORST: f64 = 0.01;

/// What is missed in all of the charts.
pub struct Details {
    pub needs: Vec<Need>,
    /// Mean light over what is shown, luminance [lx].
    pub mean: f64,
}

/// What is missed at one texel [lx], by squares of two and of four texels a side: of the light, and of half the difference of its halves.
#[derive(Clone, Copy, Debug, Default)]
struct Missed {
    light: [f32; 2],
    noise: [f32; 2],
}

/// What coarser texels would miss of each chart of shown surfaces; instances of a mesh count together. The texels of `lit` are `coarser`
/// times as dense as those of the bake.
pub fn details(scene: &Scene, atlas: &Atlas, lit: &Illuminated, coarser: f64) -> Details {
    let mut first = Vec::with_capacity(scene.surfaces.len());
    let mut count = 0;
    for surface in &scene.surfaces {
        first.push(count);
        count += atlas.meshes[surface.mesh].chart_count as usize;
    }
    let mut charts: Vec<Vec<usize>> = vec![Vec::new(); count];
    let shown = |i: usize| atlas.is_shown(lit.patches.surface(i) as usize);
    for i in (0..lit.patches.len()).filter(|i| shown(*i)) {
        charts[lit.patches.chart[i] as usize].push(i);
    }
    let missed: Vec<Vec<Missed>> = charts.par_iter().map(|chart| missed_of(atlas, lit, chart)).collect();
    let side = |level: usize| f64::from(2 << level) / coarser;
    let worst = [0, 1].map(|level| threshold(lit, &charts, &missed, level, WORST * side(level)));
    let (mut light, mut area) = (0.0, 0.0);
    let mut needs: Vec<Need> = Vec::new();
    let mut place = vec![usize::MAX; scene.meshes.len()];
    for (s, surface) in scene.surfaces.iter().enumerate().filter(|(s, _)| atlas.is_shown(*s)) {
        let uvs = &atlas.meshes[surface.mesh];
        if place[surface.mesh] == usize::MAX {
            place[surface.mesh] = needs.len();
            match &uvs.authored {
                Some(_) => needs.push(Need::none(surface.mesh, None)),
                None => needs.extend((0..uvs.chart_count).map(|c| Need::none(surface.mesh, Some(c)))),
            }
        }
        for c in 0..uvs.chart_count as usize {
            let need = &mut needs[place[surface.mesh] + if uvs.authored.is_some() { 0 } else { c }];
            let chart = first[s] + c;
            for (&i, missed) in charts[chart].iter().zip(&missed[chart]) {
                let a = f64::from(lit.exposure.area[i]);
                need.area += a;
                need.texels += f64::from(lit.patches.coverage[i]);
                let levels = missed.light.iter().zip(&missed.noise).zip(&worst);
                for (sum, ((light, noise), worst)) in need.missed.iter_mut().zip(levels) {
                    let square = |v: f32| f64::from(v).powi(2).min(*worst);
                    *sum += a * (square(*light) - square(*noise));
                }
                light += a * f64::from(luminance(lit.gathered.irradiance[i]));
                area += a;
            }
        }
    }
    Details { needs, mean: if area > 0.0 { light / area } else { 0.0 } }
}

/// The square of what is missed at a level where the worst `share` of the area begins [lx^2].
fn threshold(lit: &Illuminated, charts: &[Vec<usize>], missed: &[Vec<Missed>], level: usize, share: f64) -> f64 {
    let all = charts.iter().zip(missed).flat_map(|(chart, missed)| chart.iter().zip(missed));
    let mut squares: Vec<(f32, f32)> = all.map(|(&i, m)| (m.light[level].powi(2), lit.exposure.area[i])).collect();
    squares.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1)));
    let mut left = share * squares.iter().map(|(_, area)| f64::from(*area)).sum::<f64>();
    let begins = squares.iter().find(|(_, area)| {
        left -= f64::from(*area);
        left < 0.0
    });
    begins.map_or(0.0, |(square, _)| f64::from(*square))
}

/// What is missed at each of the patches `chart`, which are all of one chart.
fn missed_of(atlas: &Atlas, lit: &Illuminated, chart: &[usize]) -> Vec<Missed> {
    let Some(&one) = chart.first() else { return Vec::new() };
    let width = atlas.pages[lit.patches.page(one) as usize][0];
    let at = |i: usize| {
        let [_, texel] = lit.patches.texel(i);
        [texel % width, texel / width]
    };
    let places = || chart.iter().map(|i| at(*i));
    let low = places().fold([u32::MAX; 2], |low, [x, y]| [low[0].min(x), low[1].min(y)]);
    let high = places().fold([0; 2], |high, [x, y]| [high[0].max(x), high[1].max(y)]);
    let light = |i: usize| {
        let difference = lit.gathered.difference.get(i).map_or(0.0, |d| luminance(*d));
        [luminance(lit.gathered.irradiance[i]), difference]
    };
    let grids = [1, 2].map(|level| {
        let mut grid = Grid::new([0, 1].map(|k| high[k] - low[k] + 1), level);
        for (&i, [x, y]) in chart.iter().zip(places()) {
            grid.add([x - low[0], y - low[1]], light(i), lit.exposure.area[i]);
        }
        grid
    });
    let missed = |(&i, [x, y]): (&usize, [u32; 2])| {
        let [here, noise] = light(i);
        let read = grids.each_ref().map(|grid| grid.read([x - low[0], y - low[1]]).unwrap_or([here, noise]));
        Missed { light: read.map(|r| here - r[0]), noise: read.map(|r| noise - r[1]) }
    };
    chart.iter().zip(places()).map(missed).collect()
}

/// Means over squares of 2^`level` texels a side of one chart.
struct Grid {
    level: u32,
    size: [u32; 2],
    /// Sums of two values times area, and of areas.
    cells: Vec<[f32; 3]>,
}

impl Grid {
    /// Over `texels` columns and rows.
    fn new(texels: [u32; 2], level: u32) -> Self {
        let size = texels.map(|n| n.div_ceil(1 << level));
        Self { level, size, cells: vec![[0.0; 3]; size[0] as usize * size[1] as usize] }
    }

    fn add(&mut self, at: [u32; 2], values: [f32; 2], area: f32) {
        let [x, y] = at.map(|n| n >> self.level);
        let cell = &mut self.cells[(y * self.size[0] + x) as usize];
        for (sum, value) in cell.iter_mut().zip([values[0] * area, values[1] * area, area]) {
            *sum += value;
        }
    }

    /// What bilinear filtering reads at the middle of a texel, of the squares that hold something; `None` where none of them does.
    fn read(&self, at: [u32; 2]) -> Option<[f32; 2]> {
        let side = (1u32 << self.level) as f32;
        let at = at.map(|n| (n as f32 + 0.5) / side - 0.5);
        let (mut sum, mut total) = ([0.0; 2], 0.0);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, y) = (at[0].floor() + dx, at[1].floor() + dy);
            if x < 0.0 || y < 0.0 || x >= self.size[0] as f32 || y >= self.size[1] as f32 {
                continue;
            }
            let [a, b, area] = self.cells[y as usize * self.size[0] as usize + x as usize];
            let weight = (1.0 - (at[0] - x).abs()) * (1.0 - (at[1] - y).abs());
            if area > 0.0 {
                sum = [sum[0] + weight * a / area, sum[1] + weight * b / area];
                total += weight;
            }
        }
        (total > 0.0).then(|| sum.map(|s| s / total))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What squares of two and four texels miss of a function over 64 x 64 texels, root mean square.
    fn missed(f: impl Fn(f32, f32) -> f32) -> [f64; 2] {
        [1, 2].map(|level| {
            let mut grid = Grid::new([64, 64], level);
            let texels = || (0..64).flat_map(|y| (0..64).map(move |x| [x, y]));
            let at = |[x, y]: [u32; 2]| f(x as f32 + 0.5, y as f32 + 0.5);
            texels().for_each(|t| grid.add(t, [at(t), 0.0], 1.0));
            let inner = |t: &[u32; 2]| t.iter().all(|n| (4..60).contains(n));
            let square = |t| f64::from(grid.read(t).unwrap()[0] - at(t)).powi(2);
            let squares: Vec<f64> = texels().filter(inner).map(square).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        })
    }

    #[test]
    fn linear_light_is_read_without_a_miss() {
        assert!(missed(|x, y| 3.0 + 0.25 * x - 0.5 * y).iter().all(|m| *m < 1e-5));
    }

    #[test]
    fn curved_light_misses_by_the_square_of_the_texels_side_and_edges_by_its_root() {
        let [two, four] = missed(|x, y| 1e-3 * (x * x + y * y));
        assert!((4.0..6.0).contains(&(four / two)), "{}", four / two);
        let [two, four] = missed(|x, y| if x + 0.4 * y > 44.3 { 1.0 } else { 0.0 });
        assert!((1.3..2.0).contains(&(four / two)), "{}", four / two);
    }
}
