//! Patches of one block as places that light is collected at: they share a cut through the light tree and the rays of a glance.

use super::direct::Receiver;
use super::emitter::{Emitter, Sight};
use super::receiver::Site;
use super::{Lights, Lit};
use crate::patch::{Cutter, Footprint, NONE, footprint::Facet};
use crate::sample::sequence::{Sequence, Stage};
use glam::Vec3;
use std::ops::Range;

/// Patches of a block whose normals differ from the first one's by no more than this cosine face one way.
const ONE_WAY: f32 = 0.999;

/// Where a block is, and which way it faces.
pub(super) struct Stance {
    centre: Vec3,
    /// Zero where its patches face several ways.
    normal: Vec3,
    /// Radius around the centre [m].
    radius: f32,
}

impl Stance {
    /// Of a whole block, whichever of its patches are asked for.
    pub fn new(lit: &Lit, block: &Range<usize>) -> Self {
        let patches = lit.ground.patches;
        let positions = &patches.position[block.clone()];
        let centre = positions.iter().sum::<Vec3>() / positions.len() as f32;
        // A patch reaches beyond its middle by a diagonal at most.
        let reach = |i: usize| patches.position[i].distance(centre) + (2.0 * patches.area[i]).sqrt();
        let radius = block.clone().map(reach).fold(0.0, f32::max);
        let first = patches.normal[block.start];
        let is_level = block.clone().all(|i| patches.normal[i].dot(first) > ONE_WAY) && !is_shown_round(lit, block);
        Self { centre, normal: if is_level { first } else { Vec3::ZERO }, radius }
    }

    /// The emitters of `sight` that can light the block.
    pub fn emitters(&self, sight: &Sight) -> Vec<Emitter> {
        sight.emitters(self.centre, self.normal, self.radius)
    }
}

impl<'a> Sight<'a> {
    /// All that the direct light of `lit` depends on.
    pub fn of(lit: &Lit<'a>) -> Self {
        Self { scene: lit.ground.scene, tracer: lit.ground.tracer, lights: lit.lights, params: lit.params }
    }
}

/// Calls `look` with the sites of those of the `members` of a block that aren't buried, and their places among the members; `None` where
/// all are. `all` are the lamps whose nearest decides at which points light is averaged that is known without shadows: the same points for all
/// of them, so that those around a point add up.
pub(super) fn with_sites<T>(
    lit: &Lit,
    all: &Lights,
    block: &Range<usize>,
    members: &[usize],
    look: impl FnOnce(&Stance, &[usize], &[Site]) -> T,
) -> Option<T> {
    let Lit { ground, exposure, params, .. } = *lit;
    let patches = ground.patches;
    let mut cutter = Cutter::new(ground);
    let cut = |k: usize| {
        let i = members[k];
        let mut footprint = (!exposure.is_buried(i)).then(|| cutter.footprint(i)).filter(|f| !f.is_empty())?;
        footprint.restrict(exposure.cells[i]);
        Some((k, footprint))
    };
    let (open, footprints): (Vec<usize>, Vec<Footprint>) = (0..members.len()).filter_map(cut).unzip();
    if open.is_empty() {
        return None;
    }
    let samples: Vec<_> = footprints.iter().map(|f| |u| f.sample(u)).collect();
    let receiver = |(k, &member): (usize, &usize)| {
        let i = members[member];
        Receiver {
            sample: &samples[k],
            position: patches.position[i],
            normal: patches.normal[i],
            radius: footprints[k].radius(patches.position[i]),
            sequence: Sequence::new(params.seed, Stage::Direct, i as u64),
        }
    };
    let receivers: Vec<Receiver> = open.iter().enumerate().map(receiver).collect();
    let stance = Stance::new(lit, block);
    let sight = Sight { lights: all, ..Sight::of(lit) };
    let shining = if all.polygons.is_empty() { Vec::new() } else { stance.emitters(&sight) };
    let nearest = |r: &Receiver| sight.nearest(&shining, r.position);
    let sites: Vec<Site> = receivers.iter().zip(&footprints).map(|(r, f)| Site::new(r, nearest(r), Some(f))).collect();
    Some(look(&stance, &open, &sites))
}

/// Applies `look` to the sites of `members` of a block, in the light of the block's emitters; buried members have none, and get
/// the default. `all` as for [`with_sites`].
pub(super) fn at_block<T: Clone + Default>(
    lit: &Lit,
    all: &Lights,
    block: &Range<usize>,
    members: &[usize],
    look: impl FnOnce(&Sight, &[Emitter], &[Site]) -> Vec<T>,
) -> Vec<T> {
    let mut found = vec![T::default(); members.len()];
    with_sites(lit, all, block, members, |stance, open, sites| {
        let sight = Sight::of(lit);
        for (&k, value) in open.iter().zip(look(&sight, &stance.emitters(&sight), sites)) {
            found[k] = value;
        }
    });
    found
}

/// True where some patch of a block is shown rounder than it is, so that it may be lit from below its own horizon.
fn is_shown_round(lit: &Lit, block: &Range<usize>) -> bool {
    let Lit { ground, params, .. } = *lit;
    let mut last = NONE;
    params.shading_normals
        && block.clone().any(|i| {
            let number = ground.patches.first_triangle(i);
            let is_new = std::mem::replace(&mut last, number) != number;
            let (surface, triangle) = ground.tracer.place(number);
            is_new && Facet::new(ground.scene, surface, triangle).is_round()
        })
}
