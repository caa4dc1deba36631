//! USD writer: a layer over the input that holds lightmap UVs, rectangles, pages and baked colours.
//!
//! The input is its only sublayer, so references, payloads, variants and animation stay live. Every gprim with a lightmap has
//!
//! | opinion | meaning |
//! |---|---|
//! | `texCoord2f[] primvars:st1` | the mesh's lightmap UVs, faceVarying, indexed, v up; another name where a material reads `st1` |
//! | `token lumel:uvName` | the name of the primvar that holds them: ours, or an authored one that is used as it stands |
//! | `float4 primvars:lumel:scaleOffset` | the surface's rectangle: page UV = UV * (x, y) + (z, w), v up |
//! | `asset lumel:lightmap` | the page |
//! | `token lumel:quantity` | what page and colours hold: `outgoing`, `irradiance` or `radiosity` |
//! | `color3f[] primvars:lumel:irradiance` | that quantity at points or corners, not clamped |
//! | `color3f[] primvars:displayColor` | the same, where the look of the prim doesn't depend on its displayColor |
//!
//! Below a native instance the shared opinions (UVs, their name, quantity) stand on a class that the instances inherit.
//! Rectangle, page and quantity stand on the outermost instance's prim: `primvars:lumel:scaleOffset`, which the gprim inherits
//! as any constant primvar, and `lumel:lightmap`. Where an instance holds several gprims, the names end in the gprim's path
//! below it, with `:` for `/`: `primvars:lumel:scaleOffset:Geom:Back`, `lumel:lightmap:Geom:Back`.
//!
//! A point instancer has arrays with one item for each of its instances, `float4[] primvars:lumel:scaleOffset` and `int[]
//! primvars:lumel:page` (-1 for none), and `asset[] lumel:lightmaps`, the pages by that number. Where a prototype holds several
//! gprims, the arrays' names end in the gprim's whole path in the same way. The UVs are on the prototypes.
//!
//! Surfaces whose faces are not their prim's own, implicit shapes and refined subdivision surfaces, can't hold such UVs: the
//! layer makes their prim a plain Mesh of the triangles that were baked ([`stand_in`]), which is all the geometry that it
//! has. Variants that were chosen for the bake are chosen in the layer too.
//!
//! Baked colours differ between instances that share their primvars, so they are left out there. A mesh that was cut for the light
//! is whole in this layer, and has the light at its own vertices. The pieces are in a layer of their own ([`refined`]).

mod input;
mod instances;
mod layer;
mod metadata;
mod primvars;
mod refined;
mod stand_in;
mod surfaces;

use super::{Baked, BakedLights};
use crate::error::{Error, Result, Warnings};
use crate::load::Source;
use crate::load::usd::UsdSource;
use crate::scene::{BakeMode, Environment};
use input::Input;
use instances::Instances;
use layer::{Attribute, Layer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Stack of the writing thread [bytes], enough for any depth of namespace that the loader takes. Untouched pages cost
/// nothing.
const STACK: usize = 512 << 20;

/// Writes the layer to `path`, with asset paths that are right for its place in `baked.folder`.
///
/// # Errors
/// `Invalid` where the source is no USD stage or can't be read again, `Unsupported` where a file's name can't be written as
/// an asset path, `Io` where the layer can't be written.
pub fn write(path: &Path, baked: &Baked) -> Result<Warnings> {
    on_thread(path, baked, write_layer)
}

/// Writes the layer of meshes that were cut for the light to `path`: see [`refined`].
///
/// # Errors
/// As [`write`].
pub fn write_refined(path: &Path, baked: &Baked) -> Result<Warnings> {
    on_thread(path, baked, refined::write)
}

/// Writes with `write`, on a thread with stack enough.
fn on_thread(
    path: &Path,
    baked: &Baked,
    write: impl Fn(&Path, &UsdSource, &Baked) -> Result<Warnings> + Sync,
) -> Result<Warnings> {
    let Source::Usd(source) = baked.source else {
        return Err(Error::invalid(path.display(), "is a layer for a USD input, and the input is none"));
    };
    // The openusd crate recurses over the namespace and may panic on a broken file; the loader guards itself alike.
    let writer = std::thread::Builder::new().name("usd writer".into()).stack_size(STACK);
    std::thread::scope(|scope| {
        let handle = writer.spawn_scoped(scope, || write(path, source, baked));
        let failed = || Error::invalid(source.path.display(), "could not be read again; check it with usdchecker");
        handle.map_err(|e| Error::io(path, e))?.join().map_err(|_| failed())?
    })
}

fn write_layer(path: &Path, source: &UsdSource, baked: &Baked) -> Result<Warnings> {
    let mut warnings = Warnings::default();
    let mut input = Input::open(source)?;
    let mut layer = Layer::default();
    let sublayer = metadata::relative(&source.path, baked.folder)?;
    metadata::copy(&mut layer, input.stage.root_layer().data(), &sublayer, baked, &mut warnings)?;
    let mut instances = surfaces::author(baked, &mut input, &mut layer, &mut warnings)?;
    mark_lights(baked, &mut input, &mut instances, &mut layer, &mut warnings);
    save(path, source, layer)?;
    Ok(warnings)
}

/// Chooses the variants of the bake and writes the layer.
fn save(path: &Path, source: &UsdSource, mut layer: Layer) -> Result<()> {
    for selection in &source.variants {
        layer.prim(&selection.prim).variants.insert(selection.set.clone(), selection.name.clone());
    }
    let io = |e| Error::io(path, e);
    let mut out = BufWriter::new(File::create(path).map_err(io)?);
    layer.write(&mut out).and_then(|()| out.flush()).map_err(io)
}

/// Marks or deactivates every light that is in the bake: wholly baked ones as baked, those of which indirect light alone is baked by
/// what an engine has to add. Dynamic ones stay as they are.
fn mark_lights(
    baked: &Baked,
    input: &mut Input,
    instances: &mut Instances,
    layer: &mut Layer,
    warnings: &mut Warnings,
) {
    if baked.lights == BakedLights::Keep {
        return;
    }
    let skies = baked.scene.environment.iter().flat_map(Environment::each).map(|e| (&e.name, &e.contribution));
    let all = baked.scene.lights.iter().map(|l| (&l.name, &l.contribution)).chain(skies);
    // A sun or sky from the command line is named by its flag.
    let lights: BTreeMap<&str, BakeMode> =
        all.filter(|(name, _)| name.starts_with('/')).map(|(name, c)| (name.as_str(), c.mode())).collect();
    for (light, mode) in lights.into_iter().filter(|(_, mode)| *mode != BakeMode::Dynamic) {
        if input.prim(light).is_none() {
            warnings
                .add(light, "the baked light has no prim of its own in the stage, so it was not marked in the layer");
            continue;
        }
        let site = instances.site(light, input, layer);
        let prim = layer.prim(&site);
        match (mode.left_to_engine(), baked.lights) {
            (None, BakedLights::Remove) => prim.inactive = true,
            (None, _) => prim.set(Attribute::custom("bool", "lumel:baked", "1".into())),
            (Some(left), _) => {
                prim.set(Attribute::custom("token", "lumel:bake", layer::quoted(mode.name())));
                prim.set(Attribute::custom("token", "lumel:realtime", layer::quoted(left)));
            }
        }
    }
}
