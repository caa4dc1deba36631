//! Some surfaces baked anew, and the light of the others known: it is what the pages of an earlier bake show.
//!
//! As sources, the texels of known surfaces send rho times the irradiance that their pages show, in the place of their direct light. They
//! have no blocks, and so neither links nor a share in sweeps; what is selected gets direct light and links, and light goes back and
//! forth among it. That costs in proportion to what is selected, but for what every bake does with all texels: rasterize, and look which
//! lie in the open.
//!
//! Pages hold half floats as a rule: a relative error of 2^-12 at most, 50 times below the least error that can be asked for, and
//! without bias. About interpolated normals, what a page shows differs from what its surface receives as a whole, by as much
//! as rounded meshes differ from round ones.
//!
//! On the pages ([`Earlier::put_back`]) what is known stays to the bit.

use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::light::parts::{Apart, Part};
use crate::light::{Direct, Lit};
use crate::patch::Sparse;
use crate::post::dilate::{Finish, fill};
use crate::post::layers::GROUP;
use crate::post::{Layer, Lightmap, PageImage, Quantity};
use rayon::prelude::*;
use std::f32::consts::PI;
use std::sync::Arc;

/// The layer that holds directions of length 1.
const UNIT_VECTORS: &str = "bent-normal";

/// Pages of an earlier bake, whose texels lie where those of this one do.
#[derive(Clone, Debug)]
pub struct Earlier {
    /// The pages that were written; none that are hidden.
    pub lightmap: Lightmap,
    /// By surface: true where its texels stay as they are there. It lies on a page that was written.
    pub known: Vec<bool>,
}

impl Earlier {
    /// Lets texels whose light is known send it on, as if it came straight from lights: the whole, and that of each light group among
    /// `parts`.
    ///
    /// # Errors
    /// `Invalid` where there is no layer of a group.
    pub(super) fn send(&self, lit: &Lit, parts: &[Part], apart: &mut Apart) -> Result<()> {
        let whole: Vec<&[Rgb]> = self.lightmap.pages.iter().map(|page| &page.rgb[..]).collect();
        self.replace(lit, &whole, &mut apart.whole);
        for (part, direct) in parts.iter().zip(&mut apart.each) {
            let layer = self.layer(&format!("{GROUP}{}", part.group()))?;
            let values: Vec<&[Rgb]> = layer.pages.iter().map(Vec::as_slice).collect();
            self.replace(lit, &values, direct);
        }
        Ok(())
    }

    /// Makes the light of known texels that of `pages`.
    fn replace(&self, lit: &Lit, pages: &[&[Rgb]], direct: &mut Direct) {
        let light = |i: usize| lit.is_known(i).then(|| self.irradiance(lit, pages, i));
        let transport = direct.transport.par_iter().enumerate().map(|(i, e)| light(i).unwrap_or(*e)).collect();
        let transport: Arc<Vec<Rgb>> = Arc::new(transport);
        let shown: Vec<Rgb> =
            (0..transport.len()).into_par_iter().map(|i| light(i).unwrap_or(direct.shown[i])).collect();
        direct.shown = Sparse::new(Arc::clone(&transport), shown.into_iter());
        direct.transport = transport;
    }

    /// The irradiance that `pages` show of patch `i` [lx]; nothing where none of it lies in the open, or where radiosity tells none, as
    /// of what is black.
    fn irradiance(&self, lit: &Lit, pages: &[&[Rgb]], i: usize) -> Rgb {
        let [page, texel] = lit.ground.patches.texel(i).map(|n| n as usize);
        if lit.exposure.is_buried(i) {
            return Rgb::ZERO;
        }
        let value = pages[page][texel];
        let value = match self.lightmap.quantity {
            Quantity::Outgoing => value * PI,
            Quantity::Irradiance => value,
            Quantity::Radiosity => {
                let (rho, received) = (lit.reflectance.0[i], value - lit.emission.0[i] * PI);
                Rgb::select(rho.cmpgt(Rgb::ZERO), received / rho, Rgb::ZERO)
            }
        };
        value.max(Rgb::ZERO)
    }

    /// The layer `name` of the pages.
    fn layer(&self, name: &str) -> Result<&Layer> {
        self.lightmap.layers.iter().find(|layer| layer.name == name).ok_or_else(|| lacks(name))
    }

    /// Puts what is known back on `lightmap`, which was finished by `to`, its seams left out: texels and their part of gutters are what they
    /// were, to the bit, and gutters that lie between both hold both.
    ///
    /// # Errors
    /// `Invalid` where a layer isn't there.
    pub(super) fn put_back(&self, to: &Finish, lightmap: &mut Lightmap) -> Result<()> {
        let is_known = |i: usize| to.lit.is_known(i);
        // Filling is linear: what an indicator of the selected texels leaves untouched depends on none of them.
        let reached = fill(to, |i| if is_known(i) { Rgb::ZERO } else { Rgb::ONE });
        let put = |old: &[&[Rgb]], new: &mut [&mut Vec<Rgb>], is_unit: bool| {
            let change = |i: usize| {
                let [page, texel] = to.lit.ground.patches.texel(i).map(|n| n as usize);
                if is_known(i) { old[page][texel] - new[page][texel] } else { Rgb::ZERO }
            };
            let changes = fill(to, change);
            for (number, ((old, new), change)) in old.iter().zip(new).zip(&changes).enumerate() {
                let own = |t: usize| to.lit.ground.patches.at(number, t).is_some_and(|i| !is_known(i));
                let stays = |t: usize| reached[number].rgb[t] == Rgb::ZERO && !own(t);
                mend(old, new, change, is_unit, stays);
            }
        };
        let pages: Vec<&[Rgb]> = self.lightmap.pages.iter().map(|page| &page.rgb[..]).collect();
        put(&pages, &mut lightmap.pages.iter_mut().map(|page| &mut page.rgb).collect::<Vec<_>>(), false);
        for layer in &mut lightmap.layers {
            let old: Vec<&[Rgb]> = self.layer(&layer.name)?.pages.iter().map(Vec::as_slice).collect();
            put(&old, &mut layer.pages.iter_mut().collect::<Vec<_>>(), layer.name == UNIT_VECTORS);
        }
        Ok(())
    }
}

/// Takes those of the texels `new` that stay from `old`, and adds to the others what the `change` of those makes of them, which is made
/// unit again where `is_unit`.
fn mend(old: &[Rgb], new: &mut [Rgb], change: &PageImage, is_unit: bool, stays: impl Fn(usize) -> bool + Sync) {
    let is_signed = old.iter().chain(&*new).any(|v| v.min_element() < 0.0);
    let least = if is_signed { Rgb::NEG_INFINITY } else { Rgb::ZERO };
    new.par_iter_mut().enumerate().for_each(|(t, value)| {
        let change = change.rgb[t];
        *value = match stays(t) {
            true => old[t],
            false if change == Rgb::ZERO => *value,
            false if is_unit => (*value + change).normalize_or_zero(),
            false => (*value + change).max(least),
        };
    });
}

/// What to say of a layer that the earlier bake hasn't.
pub fn lacks(name: &str) -> Error {
    let message = "is a layer that the pages in the output folder don't have, so that it can't be kept of other objects; bake all of them with \
                   it first, without --only, or leave it out";
    Error::invalid(name, message)
}
