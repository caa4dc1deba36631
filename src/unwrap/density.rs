//! Densities that surfaces ask for, by mesh: all surfaces of a mesh share its UVs, and with them the size of its texels.

use crate::error::Warnings;
use crate::scene::role::HIDDEN_SCALE;
use crate::scene::{Role, Scene};

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
