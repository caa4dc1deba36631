//! The vertex layer: a layer over the input in which meshes that were cut for the light take the place of the given ones.
//!
//! As the lightmap layer it has the input as its only sublayer. A mesh that was cut is overridden where it stands by a Mesh of the
//! pieces ([`stand_in`]): transform, material, purpose, visibility and all that isn't about its faces stay the input's, and so
//! does everything else of the stage. It is the control cage at the moment of the bake, at every time. Every gprim that
//! receives light has
//!
//! | opinion | meaning |
//! |---|---|
//! | `color3f[] primvars:lumel:irradiance` | the bake's quantity at vertices, not clamped |
//! | `color3f[] primvars:displayColor` | the same, where the look of the prim doesn't depend on its displayColor |
//! | `token lumel:quantity` | what they hold: `outgoing`, `irradiance` or `radiosity` |
//!
//! Light differs between native instances, so those that hold such a gprim are taken apart (`instanceable = false`). Point
//! instancers can't be: what they draw has no light here.

use super::input::Input;
use super::instances::Instances;
use super::layer::{Attribute, Layer, array, quoted, tuple};
use super::surfaces::{DISPLAY_COLOR, colors_at_corners};
use super::{mark_lights, metadata, primvars, save, stand_in};
use crate::color::Rgb;
use crate::error::{Result, Warnings};
use crate::load::usd::UsdSource;
use crate::meshing::LitMesh;
use crate::scene::{Mesh, SurfaceOrigin, UvSet};
use crate::write::Baked;
use crate::write::pieces::Pieces;
use crate::write::split::{Vertices, split};
use std::path::Path;

/// Writes the layer to `path`; warnings are those that the lightmap layer of the same bake doesn't give.
///
/// # Errors
/// As [`super::write`].
pub fn write(path: &Path, source: &UsdSource, baked: &Baked) -> Result<Warnings> {
    let (mut warnings, mut said) = (Warnings::default(), Warnings::default());
    let mut input = Input::open(source)?;
    let mut layer = Layer::default();
    let sublayer = metadata::relative(&source.path, baked.folder)?;
    metadata::copy(&mut layer, input.stage.root_layer().data(), &sublayer, baked, &mut said)?;
    for (surface, lit) in baked.vertices.iter().flat_map(|v| v.surfaces.iter().enumerate()) {
        if !lit.triangles.is_empty() {
            author(baked, surface, lit, &mut input, &mut layer, &mut warnings);
        }
    }
    mark_lights(baked, &mut input, &mut Instances::default(), &mut layer, &mut said);
    save(path, source, layer)?;
    Ok(warnings)
}

/// Says the light of one surface, and its pieces where it was cut.
fn author(baked: &Baked, surface: usize, lit: &LitMesh, input: &mut Input, layer: &mut Layer, warnings: &mut Warnings) {
    let placed = &baked.scene.surfaces[surface];
    let path = match &placed.origin {
        SurfaceOrigin::UsdPrim => placed.name.clone(),
        SurfaceOrigin::UsdInstance { root, prim } => format!("{root}/{prim}").trim_end_matches('/').to_string(),
        SurfaceOrigin::UsdPoint { instancer, .. } => {
            let message = "what a point instancer draws shares its vertices, so it has no light in the vertex layer";
            warnings.add(instancer, message);
            return;
        }
        // The lightmap layer says so.
        SurfaceOrigin::None | SurfaceOrigin::GltfNode(_) => return,
    };
    let Some(prim) = input.prim(&path) else { return };
    let mesh = &baked.scene.meshes[placed.mesh];
    let is_remade = input.is_remade(placed.mesh);
    let shows_own = input.needs_display_color(&prim);
    let mut attributes = if is_remade || !lit.is_given() {
        let (mesh, light) = refine(mesh, lit);
        // What is lost of a remade one is lost in the lightmap layer too.
        let warnings = if is_remade { &mut Warnings::default() } else { &mut *warnings };
        if prim.attribute("points").num_time_samples().unwrap_or(0) > 1 {
            warnings.add(&path, "moves its points; in the vertex layer it stands still, as it was baked");
        }
        stand_in::place(&prim, &mesh, is_remade, &path, input, layer, warnings);
        at_points(&light, shows_own)
    } else {
        let Some(topology) = input.topology(&prim, placed.mesh, mesh) else { return };
        let colors: Vec<[Rgb; 3]> = lit.triangles.iter().map(|t| t.values).collect();
        colors_at_corners(&prim, &colors, &topology, shows_own)
    };
    attributes.push(Attribute::custom("token", "lumel:quantity", quoted(baked.quantity.name())));
    for instance in input.instances_above(&path) {
        layer.prim(&instance).taken_apart = true;
    }
    let over = layer.prim(&path);
    attributes.into_iter().for_each(|a| over.set(a));
}

/// The mesh of the pieces `lit` of `mesh`, and the light at its vertices.
fn refine(mesh: &Mesh, lit: &LitMesh) -> (Mesh, Vec<[f32; 3]>) {
    let light: Vec<[[f32; 3]; 3]> = lit.triangles.iter().map(|t| t.values.map(|v| v.to_array())).collect();
    let pieces = Pieces::cut(&lit.triangles, &light);
    let mut vertices = Vertices::new(mesh.positions.len());
    let face = |p: usize| pieces.face(p, mesh, mesh.triangles[pieces.source(p)], &mut vertices);
    let faces: Vec<[u32; 3]> = (0..pieces.len()).map(face).collect();
    let split = split(vertices, &faces, &light.iter().copied().map(Some).collect::<Vec<_>>());
    let vertices = &split.sources;
    let uvs = mesh
        .uvs
        .iter()
        .map(|set| UvSet { name: set.name.clone(), coords: vertices.iter().map(|v| v.coords(&set.coords)).collect() });
    let sources = || lit.triangles.iter().map(|t| t.source as usize);
    let only = |has: bool| vertices.iter().filter(move |_| has);
    let refined = Mesh {
        name: mesh.name.clone(),
        positions: vertices.iter().map(|v| v.point(&mesh.positions)).collect(),
        normals: only(!mesh.normals.is_empty()).map(|v| v.direction(&mesh.normals)).collect(),
        uvs: uvs.collect(),
        colors: only(!mesh.colors.is_empty()).map(|v| v.color(&mesh.colors)).collect(),
        triangle_material: sources().map(|t| mesh.triangle_material[t]).collect(),
        origin: sources().map(|t| mesh.origin[t]).collect(),
        triangles: split.triangles,
    };
    (refined, split.values)
}

/// The light of a Mesh with one value a point; `shows_own`: without displayColor.
fn at_points(light: &[[f32; 3]], shows_own: bool) -> Vec<Attribute> {
    let value = array(light, |text, v| tuple(text, v));
    let mut attributes = vec![Attribute::primvar("color3f[]", "lumel:irradiance", "vertex", value.clone())];
    if !shows_own {
        let shown = Attribute::primvar("color3f[]", DISPLAY_COLOR, "vertex", value);
        attributes.extend([Attribute { baked: true, ..shown }, primvars::indices(DISPLAY_COLOR, "None".into())]);
    }
    attributes
}
