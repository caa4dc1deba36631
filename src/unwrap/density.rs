//! Densities that surfaces ask for, by mesh: all surfaces of a mesh share its UVs, and with them the size of its texels.

use super::chart::Chart;
use super::layout::Content;
use super::{Importance, UnwrapParams, volume};
use crate::error::Warnings;
use crate::scene::role::HIDDEN_SCALE;
use crate::scene::{Role, Scene};
use rayon::prelude::*;

/// A mesh's density: its own or the bake's, times a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Texels per metre; none: those of the bake.
    pub own: Option<f64>,
    pub scale: f64,
}

impl Default for Share {
    fn default() -> Self {
        Self { own: None, scale: 1.0 }
    }
}

impl Share {
    /// That of a surface on its own.
    pub fn of(role: &Role) -> Self {
        let is_coarse = !role.receives && role.density.is_none();
        let scale = if is_coarse { HIDDEN_SCALE * role.density_scale } else { role.density_scale };
        Self { own: role.density.map(f64::from), scale: f64::from(scale) }
    }

    /// Texels per metre where the bake has `density` in place of the `asked` for: where all of it had to be lowered, so are
    /// densities of surfaces' own.
    pub fn at(&self, density: f64, asked: f64) -> f64 {
        self.scale * self.own.map_or(density, |own| own * (density / asked))
    }

    /// The density of the bake at which surfaces, by area [m²] and share, have about `count` texels. Those with a density of
    /// their own take theirs first, but nine tenths at most; where all have their own, it is the mean. Not finite without
    /// area.
    pub fn density_of(surfaces: impl Iterator<Item = (f64, Self)>, count: f64) -> f64 {
        let (mut even, mut own, mut own_area) = (0.0, 0.0, 0.0);
        for (area, share) in surfaces {
            match share.own {
                None => even += area * share.scale.powi(2),
                Some(density) => {
                    own += area * (share.scale * density).powi(2);
                    own_area += area;
                }
            }
        }
        if even > 0.0 { ((count - own).max(0.1 * count) / even).sqrt() } else { (own / own_area).sqrt() }
    }
}

/// The share of each mesh, whose surfaces are `users`. Where shown surfaces of one mesh disagree, what most of them ask for
/// holds (of equals, what the first one does), with a warning; hidden ones follow them, and of these those that don't receive
/// the others.
pub fn shares(scene: &Scene, users: &[Vec<usize>], warnings: &mut Warnings) -> Vec<Share> {
    let share = |users: &Vec<usize>| {
        let role = |s: usize| &scene.surfaces[s].role;
        // Those that are shown speak first, then those whose light is wanted at all.
        let voice = |s: usize| u8::from(role(s).is_shown()) + u8::from(role(s).receives);
        let loudest = users.iter().map(|s| voice(*s)).max().unwrap_or(0);
        let asking = || users.iter().copied().filter(|s| voice(*s) == loudest);
        let mut votes: Vec<(Share, usize)> = Vec::new();
        for share in asking().map(|s| Share::of(role(s))) {
            match votes.iter_mut().find(|(known, _)| *known == share) {
                Some((_, count)) => *count += 1,
                None => votes.push((share, 1)),
            }
        }
        let most = votes.iter().map(|(_, count)| *count).max()?;
        let (held, _) = votes.into_iter().find(|(_, count)| *count == most)?;
        for s in asking().filter(|s| Share::of(role(*s)) != held) {
            let message = "shares its UVs with surfaces of another density; what most of them ask for holds for all";
            warnings.add(&scene.surfaces[s].name, message);
        }
        Some(held)
    };
    users.iter().map(share).map(Option::unwrap_or_default).collect()
}

/// Densities once volumes and importance are in them.
pub struct Factored {
    /// By mesh: of authored sets that are kept, the factor is part of the scale; charts hold theirs.
    pub shares: Vec<Share>,
    /// Area of each surface [m²] times the square of the factor that its charts have.
    pub areas: Vec<f64>,
}

/// Gives charts, and authored sets by their mesh's share, the factors that `params` ask for. A mesh of several surfaces has one
/// layout: of volumes, it gets what the surface gets that gets most.
pub fn factor(
    scene: &Scene,
    users: &[Vec<usize>],
    areas: &[f64],
    params: &UnwrapParams,
    mut shares: Vec<Share>,
    contents: &mut [Content],
) -> Factored {
    if params.volumes.is_empty() && params.importance.is_none() {
        return Factored { shares, areas: areas.to_vec() };
    }
    let even = params.importance.as_ref().map(|i| evening(scene, users, areas, &shares, i, contents));
    let none = Importance::default();
    let importance = params.importance.as_ref().unwrap_or(&none);
    let means: Vec<f64> = (contents.par_iter_mut().zip(&mut shares).enumerate())
        .map(|(m, (content, share))| {
            let even = even.as_ref().map_or(1.0, |e| e[m]);
            let by_volumes = |triangles: &[u32]| {
                let of = |s: &usize| volume_factor(scene, *s, triangles, params);
                users[m].iter().map(of).fold(0.0, f64::max)
            };
            match content {
                Content::Charts(charts) => {
                    for (c, chart) in charts.iter_mut().enumerate() {
                        chart.factor = even * importance.of(m, c) * by_volumes(&chart.triangles);
                    }
                    mean_square(charts)
                }
                Content::Shared(charts) => {
                    let all: Vec<u32> = (0..scene.meshes[m].triangles.len() as u32).collect();
                    let of_mesh = by_volumes(&all);
                    for (c, chart) in charts.iter_mut().enumerate() {
                        chart.factor = even * importance.of(m, c) * of_mesh;
                    }
                    mean_square(charts)
                }
                Content::Authored { .. } => {
                    let all: Vec<u32> = (0..scene.meshes[m].triangles.len() as u32).collect();
                    share.scale *= even * authored_factor(importance, m) * by_volumes(&all);
                    1.0
                }
                Content::Unused => 1.0,
            }
        })
        .collect();
    let areas = scene.surfaces.iter().zip(areas).map(|(s, area)| area * means[s.mesh]).collect();
    Factored { shares, areas }
}

/// By mesh, the factor that keeps the texels of shown surfaces what they would be without `importance`: one for all of the bake's
/// density, and one for each mesh of its own.
fn evening(
    scene: &Scene,
    users: &[Vec<usize>],
    areas: &[f64],
    shares: &[Share],
    importance: &Importance,
    contents: &[Content],
) -> Vec<f64> {
    let square = |m: usize| match &contents[m] {
        Content::Charts(charts) | Content::Shared(charts) => {
            weighed_mean(charts.iter().enumerate().map(|(c, chart)| (chart.area(), importance.of(m, c).powi(2))))
        }
        Content::Authored { .. } => authored_factor(importance, m).powi(2),
        Content::Unused => 1.0,
    };
    let squares: Vec<f64> = (0..contents.len()).map(square).collect();
    let texels = |m: usize| {
        let shown = users[m].iter().filter(|s| scene.surfaces[**s].role.is_shown());
        shown.map(|s| areas[*s]).sum::<f64>() * shares[m].scale.powi(2)
    };
    let bakes_own = (0..contents.len()).filter(|m| shares[*m].own.is_none());
    let of_all = weighed_mean(bakes_own.map(|m| (texels(m), squares[m])));
    let mean = |m: usize| if shares[m].own.is_none() { of_all } else { squares[m] };
    (0..contents.len()).map(|m| mean(m).sqrt().recip()).collect()
}

/// The factor of an authored set that is kept: the root of the mean square of its charts' factors.
fn authored_factor(importance: &Importance, mesh: usize) -> f64 {
    let count = importance.factors.get(mesh).map_or(0, Vec::len);
    let sum: f64 = (0..count).map(|c| importance.of(mesh, c).powi(2)).sum();
    if count > 0 { (sum / count as f64).sqrt() } else { 1.0 }
}

/// The mean square of the charts' factors over their area.
fn mean_square(charts: &[Chart]) -> f64 {
    weighed_mean(charts.iter().map(|c| (c.area(), c.factor.powi(2))))
}

/// The mean of (weight, value); 1 without weight.
fn weighed_mean(items: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (sum, total) = items.fold((0.0, 0.0), |(s, t), (weight, value)| (s + weight * value, t + weight));
    if total > 0.0 { sum / total } else { 1.0 }
}

/// The factor that volumes give some triangles of a surface.
fn volume_factor(scene: &Scene, surface: usize, triangles: &[u32], params: &UnwrapParams) -> f64 {
    if params.volumes.is_empty() {
        return 1.0;
    }
    let weighed = |&t: &u32| {
        let corners = scene.world_triangle(surface, t as usize);
        let [a, b, c] = corners.map(|p| p.as_dvec3());
        (0.5 * (b - a).cross(c - a).length(), volume::mean_square(&params.volumes, corners))
    };
    weighed_mean(triangles.iter().map(weighed)).sqrt()
}
