//! The energy balance of a bake, from the texels as they are written: what comes in is absorbed or escapes.
//!
//! In: the emitted power of surfaces, and the flux of other lights and the sky where it meets a surface. Out: `(1 - rho) E A`
//! of every texel, and what is sent and lands on nothing that can reflect it: of emitted light as rays of its own tell
//! ([`emitted`]), of reflected light by the share of each texel's rays that landed. Backs of double-sided surfaces are shown
//! by no texel; their part comes from [`Backs`], as far as the rest of the scene sees them. Parts of texels that lie inside other geometry don't count,
//! nor do surfaces that receive without casting: the light on them goes on to what lies behind. Nor does what passes through sheets:
//! it is absorbed elsewhere, or escapes (by channel, what escapes through coloured panes is told by its mean).
//!
//! Pages show irradiance about the shading normal, which differs from what a surface receives: on smooth-shaded meshes the
//! balance says less than with geometric normals.

mod emitted;

use crate::color::Rgb;
use crate::gather::{Backs, Gathered};
use crate::light::{Direct, Lit};
use crate::post::{Lightmap, Quantity};
use glam::DVec3;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;

/// Power by channel [lm], and how well it adds up.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct EnergyBalance {
    /// Sent out by emissive surfaces.
    pub emitted: [f64; 3],
    /// Received straight from the sky and from lights that are no surface.
    pub inflow: [f64; 3],
    /// Absorbed by what is shown on the pages.
    pub absorbed: [f64; 3],
    /// Received by mirrors and glass that are black beside light over mirrors and glass, off other surfaces or from the sky, and lost:
    /// part of nothing else here.
    pub lost_on_mirrors: [f64; 3],
    /// Absorbed by the backs of double-sided surfaces.
    pub absorbed_by_backs: [f64; 3],
    /// Escaped from the scene, or fallen on the black backs of single-sided surfaces.
    pub escaped: [f64; 3],
    /// Sum over channels of (out - in), relative to what came in.
    pub imbalance: f64,
}

impl EnergyBalance {
    /// The share of the light that was lost on mirrors and glass.
    pub fn lost_share(&self) -> f64 {
        let sum = |power: &[f64; 3]| power.iter().sum::<f64>();
        let into = sum(&self.emitted) + sum(&self.inflow);
        if into > 0.0 { sum(&self.lost_on_mirrors) / into } else { 0.0 }
    }

    /// True where nothing was balanced.
    pub fn is_empty(&self) -> bool {
        let sum = |power: &[f64; 3]| power.iter().sum::<f64>();
        sum(&self.emitted) + sum(&self.inflow) + sum(&self.absorbed) == 0.0
    }
}

/// What is balanced.
pub struct Bake<'a> {
    pub lit: Lit<'a>,
    pub direct: &'a Direct,
    pub backs: &'a Backs,
    pub gathered: &'a Gathered,
    /// What arrives and is on no page, as an engine adds it [lx], by patch.
    pub left_out: Option<&'a [Rgb]>,
    /// Patches of mirrors and glass, ascending, and what came to each that is no more theirs to send on [lx]: it is part of the inflow
    /// where it lands.
    pub taken: &'a [(u32, Rgb)],
}

/// Adds up the power of `bake` with the irradiance read from the pages of `lightmap`, rounded to half precision where `half`; what
/// half floats don't hold counts as it is.
pub fn balance(bake: &Bake, lightmap: &Lightmap, half: bool) -> EnergyBalance {
    let count = bake.lit.ground.patches.len();
    let parts: Vec<Power> = (0..count.div_ceil(PART))
        .into_par_iter()
        .map(|part| power(bake, lightmap, half, part * PART..count.min((part + 1) * PART)))
        .collect();
    let Power { emitted, absorbed, lost, mut escaped } = parts.into_iter().fold(Power::default(), Power::add);
    escaped += emitted::escaped(&bake.lit, bake.backs);
    let mut backs = DVec3::ZERO;
    let all = bake.backs;
    for (b, area) in all.area.iter().enumerate() {
        let (rho, received) = (all.albedo[b].as_dvec3(), f64::from(*area) * all.irradiance[b].as_dvec3());
        backs += (all.taking[b].as_dvec3() - rho) * received;
        escaped += (1.0 - f64::from(all.landed_share[b])) * rho * received;
    }
    let inflow = bake.direct.inflow + bake.gathered.sky_inflow + bake.backs.inflow;
    let (into, out) = (emitted + inflow, absorbed + lost + backs + escaped);
    EnergyBalance {
        emitted: emitted.to_array(),
        inflow: inflow.to_array(),
        absorbed: absorbed.to_array(),
        lost_on_mirrors: lost.to_array(),
        absorbed_by_backs: backs.to_array(),
        escaped: escaped.to_array(),
        imbalance: (out - into).element_sum() / into.element_sum().max(f64::MIN_POSITIVE),
    }
}

/// Patches whose power is added up at once.
const PART: usize = 1 << 14;

/// Power of some patches by channel [lm].
#[derive(Clone, Copy, Default)]
struct Power {
    emitted: DVec3,
    absorbed: DVec3,
    lost: DVec3,
    escaped: DVec3,
}

impl Power {
    fn add(self, other: Self) -> Self {
        Self {
            emitted: self.emitted + other.emitted,
            absorbed: self.absorbed + other.absorbed,
            lost: self.lost + other.lost,
            escaped: self.escaped + other.escaped,
        }
    }
}

/// What the patches in `range` emit, absorb, and let escape of what they reflect.
fn power(bake: &Bake, lightmap: &Lightmap, half: bool, range: Range<usize>) -> Power {
    let patches = bake.lit.ground.patches;
    let mut power = Power::default();
    for i in range.filter(|&i| bake.lit.ground.casts(i)) {
        let (area, whole) = (f64::from(bake.lit.exposure.area[i]), f64::from(bake.lit.exposure.back_area(patches, i)));
        let rho = bake.lit.reflectance.0[i].as_dvec3();
        let emittance = PI * bake.lit.emission.0[i].as_dvec3();
        power.emitted += area * emittance;
        let landed = f64::from(bake.gathered.landed_share[i]);
        let irradiance = if bake.lit.exposure.is_buried(i) {
            // Filled for display; no light reaches it.
            DVec3::ZERO
        } else {
            let left_out = bake.left_out.map_or(DVec3::ZERO, |left_out| left_out[i].as_dvec3());
            written_irradiance(lightmap, patches.texel(i), rho, emittance, half) + left_out
        };
        let taken = bake.taken.binary_search_by_key(&(i as u32), |of| of.0).ok().map(|k| bake.taken[k].1.as_dvec3());
        let reflected = area * rho * (irradiance - taken.unwrap_or_default()).max(DVec3::ZERO);
        let kept = bake.lit.exposure.taking_area(i) * irradiance - reflected;
        match taken.filter(|_| rho == DVec3::ZERO) {
            Some(taken) => {
                let sent_on = (area * taken).min(kept);
                power.absorbed += sent_on;
                power.lost += kept - sent_on;
            }
            None => power.absorbed += kept,
        }
        power.escaped += (1.0 - landed) * reflected;
        if bake.backs.of_patch[i] != crate::patch::NONE {
            power.emitted += whole * emittance;
        }
    }
    power
}

/// The irradiance that a page's texel says [lx].
fn written_irradiance(lightmap: &Lightmap, [page, texel]: [u32; 2], rho: DVec3, emittance: DVec3, half: bool) -> DVec3 {
    let value = lightmap.pages[page as usize].rgb[texel as usize];
    let value = if half {
        value.to_array().map(|v| if v > half::f16::MAX.to_f32() { v } else { half::f16::from_f32(v).to_f32() }).into()
    } else {
        value
    }
    .as_dvec3();
    match lightmap.quantity {
        Quantity::Outgoing => value * PI,
        Quantity::Irradiance => value,
        Quantity::Radiosity => DVec3::select(
            rho.cmpgt(DVec3::ZERO),
            (value - emittance) / rho.max(DVec3::splat(f64::MIN_POSITIVE)),
            DVec3::ZERO,
        ),
    }
}
