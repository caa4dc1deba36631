//! Hashes of what results depend on: two scenes that have one in common need the work behind it done only once.
//!
//! | key | of |
//! |---|---|
//! | [`geometry`] | the ways of rays and the places of texels, over the whole scene |
//! | [`surface`], [`surfaces`] | the same, of one surface, wherever it stands in the scene |
//! | [`mesh`] | the content of a mesh |
//! | [`atlas`] | the lightmap UVs |
//! | [`places`] | the same, of each surface, wherever its page stands among the others |
//! | [`shining`] | the direct light of one source, its strength left out and given beside |
//!
//! What is left out of a key is named in the patterns below, which name every field: a new one doesn't compile until it is dealt with.
//! Numbers count by their bits and lists by their order, so a key may differ where results don't; never the other way round.

use crate::color::Rgb;
use crate::light::Shining;
use crate::scene::projector::{Picture, Projector};
use crate::scene::{
    Alpha, Environment, Light, LightShape, Linked, Links, Material, Mesh, PhotometricWeb, Profile, Scene, Surface,
    Texels, Texture, TextureSlot, UvSet,
};
use crate::store::{Hasher, Key};
use crate::unwrap::{Atlas, MeshUvs, Placement};
use bytemuck::NoUninit;
use glam::{Mat3, Vec3};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Texels whose channels are picked at once.
const PICKED: usize = 1 << 16;

/// The key of all that the ways of rays and the places of texels depend on: meshes, placements and roles of surfaces, and what of their
/// materials decides where light passes. Albedo, emission (but for whether backs shine), lights, skies, media, cameras and names
/// aren't part of it. Indices into the scene's lists of surfaces, meshes and materials stay good while it is the same.
pub fn geometry(scene: &Scene) -> Key {
    let Scene { meshes, materials, textures: _, surfaces, lights: _, environment: _, cameras: _, media: _ } = scene;
    let bodies = Bodies::new(scene, surfaces.iter().map(|s| s.mesh));
    Key::of("geometry 1", |h| {
        h.add_debug(&[meshes.len(), materials.len(), surfaces.len()]);
        for (&mesh, body) in &bodies.0 {
            h.add_u64(mesh as u64);
            h.add_key(body.key);
            h.add_slice(&body.materials);
        }
        for (surface, key) in surfaces.iter().zip(bodies.surfaces(surfaces)) {
            h.add_u64(surface.mesh as u64);
            h.add_key(key);
        }
    })
}

/// The key of surface `surface` (index): its mesh, placement and role, and what of its materials decides where light passes. Its own
/// place in the scene, its mesh's and its materials' aren't part of it.
pub fn surface(scene: &Scene, surface: usize) -> Key {
    let surface = &scene.surfaces[surface];
    Bodies::new(scene, [surface.mesh]).surface(surface)
}

/// The keys that [`surface`] gives for all surfaces, in order; meshes in common are read once.
pub fn surfaces(scene: &Scene) -> Vec<Key> {
    let bodies = Bodies::new(scene, scene.surfaces.iter().map(|s| s.mesh));
    bodies.surfaces(&scene.surfaces)
}

/// The key of what a mesh holds: positions, normals, UVs, triangles, and the numbers of their materials; not colours, nor where it came
/// from.
pub fn mesh(mesh: &Mesh) -> Key {
    Key::of("mesh 1", |h| {
        h.add_key(shape(mesh));
        h.add_slice(&mesh.triangle_material);
    })
}

/// The keys of lightmap UVs, by mesh.
fn uvs(meshes: &[MeshUvs]) -> Vec<Key> {
    let key = |uvs: &MeshUvs| {
        let MeshUvs { corners, chart, chart_count, authored } = uvs;
        Key::of("mesh UVs 1", |h| {
            h.add_slice(corners);
            h.add_slice(chart);
            h.add_debug(&(chart_count, authored));
        })
    };
    meshes.par_iter().map(key).collect()
}

/// The keys of the texels that each surface of `scene` covers on its page. Which of the pages that is isn't part of them.
pub fn places(scene: &Scene, atlas: &Atlas) -> Vec<Key> {
    let meshes = uvs(&atlas.meshes);
    let place = |(surface, placement): (&Surface, &Placement)| {
        let Placement { page, scale, offset } = *placement;
        Key::of("place 1", |h| {
            h.add_key(meshes[surface.mesh]);
            h.add_slice(&[scale.to_array(), offset.to_array()]);
            h.add_slice(&atlas.pages[page as usize]);
        })
    };
    scene.surfaces.iter().zip(&atlas.placements).map(place).collect()
}

/// The key of lightmap UVs: all of an atlas.
pub fn atlas(atlas: &Atlas) -> Key {
    let Atlas { pages, meshes, placements, density, padding, shown_pages } = atlas;
    let meshes = uvs(meshes);
    let placement = |placement: &Placement| {
        let Placement { page, scale, offset } = *placement;
        [page, scale.x.to_bits(), scale.y.to_bits(), offset.x.to_bits(), offset.y.to_bits()]
    };
    let placements: Vec<[u32; 5]> = placements.iter().map(placement).collect();
    Key::of("atlas 1", |h| {
        h.add_slice(pages);
        h.add_u64(meshes.len() as u64);
        meshes.into_iter().for_each(|key| h.add_key(key));
        h.add_slice(&placements);
        h.add_debug(&(density, padding, shown_pages));
    })
}

/// The key of what the direct light of `shining` depends on apart from its strength, and the strength, of which the light is a multiple
/// by channel: intensity [cd], illuminance [lx], radiance [nit] or the factor on emission [nit].
///
/// Pictures, photometric webs and textures count by their content; names, the part in the bake and the node of the file don't. What
/// light falls on and what blocks it isn't part of the key ([`geometry`]), but for links; of a material the surfaces are that it shines
/// from. A portal to several skies at once has no strength of its own: its key holds theirs, and the strength is 1.
pub fn shining(scene: &Scene, shining: Shining) -> (Key, Rgb) {
    let mut strength = Rgb::ONE;
    let key = match shining {
        Shining::Light(l) => Key::of("light 1", |h| strength = add_light(h, scene, &scene.lights[l])),
        Shining::Material(m) => Key::of("emissive material 1", |h| strength = add_emission(h, scene, m)),
        Shining::Sky(k) => {
            let sky = scene.environment.as_ref().and_then(|sky| sky.each().nth(k)).expect("a sky of the scene");
            Key::of("sky 1", |h| strength = add_sky(h, scene, sky))
        }
    };
    (key, strength)
}

/// What is known of the meshes of surfaces, by index.
struct Bodies(BTreeMap<usize, Body>);

/// A mesh with its materials.
struct Body {
    /// Of the mesh and of what its materials let through, wherever these stand in the scene.
    key: Key,
    /// The indices of its materials in the order of their first triangles.
    materials: Vec<u32>,
}

impl Bodies {
    /// Those of the meshes `meshes` (indices).
    fn new(scene: &Scene, meshes: impl IntoIterator<Item = usize>) -> Self {
        let mut meshes: Vec<usize> = meshes.into_iter().collect();
        meshes.sort_unstable();
        meshes.dedup();
        let split: Vec<(usize, Vec<u32>, Vec<u32>)> = meshes
            .into_par_iter()
            .map(|m| {
                let (ordinals, materials) = ordinals(&scene.meshes[m].triangle_material);
                (m, ordinals, materials)
            })
            .collect();
        let mut used: Vec<u32> = split.iter().flat_map(|(_, _, materials)| materials).copied().collect();
        used.sort_unstable();
        used.dedup();
        let pictures = Pictures::of_passing(scene, &used);
        let passing: BTreeMap<u32, Key> = used
            .into_iter()
            .map(|m| (m, Key::of("passing 1", |h| add_passing(h, &scene.materials[m as usize], &pictures))))
            .collect();
        let body = |(m, ordinals, materials): (usize, Vec<u32>, Vec<u32>)| {
            let mesh = &scene.meshes[m];
            let fades = materials.iter().any(|&k| scene.materials[k as usize].alpha != Alpha::Opaque);
            let key = Key::of("body 1", |h| {
                h.add_key(shape(mesh));
                h.add_slice(&ordinals);
                materials.iter().for_each(|k| h.add_key(passing[k]));
                // Alpha of vertex colours is part of the opacity.
                let alphas = mesh.colors.iter().filter(|_| fades).map(|color| color.w);
                h.add_slice(&alphas.collect::<Vec<f32>>());
            });
            (m, Body { key, materials })
        };
        Self(split.into_par_iter().map(body).collect::<Vec<_>>().into_iter().collect())
    }

    /// The keys of surfaces of the meshes, in order.
    fn surfaces(&self, surfaces: &[Surface]) -> Vec<Key> {
        surfaces.par_iter().map(|surface| self.surface(surface)).collect()
    }

    /// The key of a surface of one of the meshes.
    fn surface(&self, surface: &Surface) -> Key {
        let Surface { name: _, mesh, world_from_local, origin: _, role } = surface;
        Key::of("surface 1", |h| {
            h.add_key(self.0[mesh].key);
            h.add_slice(&world_from_local.to_cols_array());
            h.add_debug(role);
        })
    }
}

/// The materials of triangles numbered by their first triangles, and which they are.
fn ordinals(triangle_material: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let (mut numbers, mut materials) = (BTreeMap::new(), Vec::new());
    let mut last = None;
    let ordinals = triangle_material.iter().map(|&m| match last {
        Some((known, number)) if known == m => number,
        _ => {
            let number = *numbers.entry(m).or_insert_with(|| {
                materials.push(m);
                materials.len() as u32 - 1
            });
            last = Some((m, number));
            number
        }
    });
    (ordinals.collect(), materials)
}

/// The key of a mesh without its materials.
fn shape(mesh: &Mesh) -> Key {
    let Mesh { name: _, positions, normals, uvs, colors: _, triangles, triangle_material: _, origin: _ } = mesh;
    Key::of("shape 1", |h| {
        h.add_slice(positions);
        h.add_slice(normals);
        h.add_slice(triangles);
        for UvSet { name, coords } in uvs {
            h.add_str(name);
            h.add_slice(coords);
        }
    })
}

/// Adds what of a material decides where light passes.
fn add_passing(h: &mut Hasher, material: &Material, pictures: &Pictures) {
    let Material {
        name: _,
        albedo: _,
        // As far as it gives the opacity, by `opacity_slot`.
        albedo_texture: _,
        emission: _,
        emission_texture: _,
        transmission,
        transmission_texture: _,
        double_sided,
        alpha,
        opacity_texture: _,
        contribution: _,
        appearance: _,
    } = material;
    h.add_debug(&(double_sided, alpha, *double_sided && material.is_emissive()));
    h.add_slice(&transmission.to_array());
    add_slot(h, material.opacity_slot(), Channels::Alpha, pictures);
    add_slot(h, tint_slot(material), Channels::Color, pictures);
}

/// The texture by which a material's transmission is multiplied, where that makes a difference.
fn tint_slot(material: &Material) -> Option<&TextureSlot> {
    material.transmission_texture.as_ref().filter(|_| material.transmission != Rgb::ZERO)
}

/// Adds a use of a texture, as far as `channels` are read.
fn add_slot(h: &mut Hasher, slot: Option<&TextureSlot>, channels: Channels, pictures: &Pictures) {
    let Some(slot) = slot else { return h.add_str("no texture") };
    let TextureSlot { texture, uv_set, image_from_uv, wrap, scale, bias } = slot;
    h.add_key(pictures.key(*texture, channels));
    h.add_str(uv_set);
    h.add_slice(&image_from_uv.to_cols_array());
    h.add_debug(wrap);
    match channels {
        Channels::Alpha => h.add_slice(&[scale.w, bias.w]),
        Channels::Color => h.add_slice(&[scale.truncate().to_array(), bias.truncate().to_array()]),
        Channels::All => h.add_slice(&[scale.to_array(), bias.to_array()]),
    }
}

/// What of a picture is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Channels {
    All,
    Color,
    Alpha,
}

/// Keys of textures, by index and by what of them is read.
struct Pictures(BTreeMap<(usize, Channels), Key>);

impl Pictures {
    /// Those of the textures that decide where light passes through the materials `materials` (indices).
    fn of_passing(scene: &Scene, materials: &[u32]) -> Self {
        let materials = materials.iter().map(|&m| &scene.materials[m as usize]);
        Self::of(scene, materials.flat_map(|m| [(m.opacity_slot(), Channels::Alpha), (tint_slot(m), Channels::Color)]))
    }

    fn of<'a>(scene: &Scene, slots: impl IntoIterator<Item = (Option<&'a TextureSlot>, Channels)>) -> Self {
        let used = slots.into_iter().filter_map(|(slot, channels)| Some((slot?.texture, channels)));
        let mut used: Vec<(usize, Channels)> = used.collect();
        used.sort_unstable();
        used.dedup();
        let keys = used.into_par_iter().map(|(t, channels)| ((t, channels), picture(&scene.textures[t], channels)));
        Self(keys.collect::<Vec<_>>().into_iter().collect())
    }

    fn key(&self, texture: usize, channels: Channels) -> Key {
        self.0[&(texture, channels)]
    }
}

/// The key of a texture's content.
fn picture(texture: &Texture, channels: Channels) -> Key {
    let Texture { name: _, width, height, texels } = texture;
    Key::of("picture 1", |h| {
        h.add_debug(&(width, height, channels));
        match (texels, channels) {
            // Linear in both.
            (Texels::Srgb8(t) | Texels::Linear8(t), Channels::Alpha) => add_picked(h, t, |&[.., a]| [a]),
            (Texels::Float(t), Channels::Alpha) => add_picked(h, t, |&[.., a]| [a]),
            (Texels::Srgb8(t), _) => {
                h.add_str("sRGB");
                add_texels(h, t, channels);
            }
            (Texels::Linear8(t), _) => add_texels(h, t, channels),
            (Texels::Float(t), _) => add_texels(h, t, channels),
        }
    })
}

fn add_texels<T: NoUninit + Sync>(h: &mut Hasher, texels: &[[T; 4]], channels: Channels) {
    match channels {
        Channels::All => h.add_slice(texels.as_flattened()),
        Channels::Color => add_picked(h, texels, |&[r, g, b, _]| [r, g, b]),
        Channels::Alpha => add_picked(h, texels, |&[.., a]| [a]),
    }
}

/// Adds what `pick` takes of each texel.
fn add_picked<T: NoUninit + Sync, const N: usize>(
    h: &mut Hasher,
    texels: &[[T; 4]],
    pick: impl Fn(&[T; 4]) -> [T; N] + Sync,
) {
    let key = |texels: &[[T; 4]]| {
        let picked: Vec<T> = texels.iter().flat_map(&pick).collect();
        Key::of("texels 1", |h| h.add_slice(&picked))
    };
    let keys: Vec<Key> = texels.par_chunks(PICKED).map(key).collect();
    keys.into_iter().for_each(|key| h.add_key(key));
}

/// Adds a light; returns its strength.
fn add_light(h: &mut Hasher, scene: &Scene, light: &Light) -> Rgb {
    let Light { name: _, shape, world_from_light, shaping, profile, picture, links, contribution: _, gltf_node: _ } =
        light;
    add_matrix(h, world_from_light);
    h.add_debug(shaping);
    match profile {
        None => h.add_str("no profile"),
        Some(profile) => add_profile(h, profile),
    }
    match picture {
        None => h.add_str("no picture"),
        Some(Picture::OnLight(texture)) => {
            h.add_str("on the light");
            add_picture(h, scene, *texture);
        }
        Some(Picture::Thrown(projector)) => {
            let Projector { texture, picture_from_direction, focus } = projector;
            h.add_str("thrown");
            add_picture(h, scene, *texture);
            add_matrix(h, picture_from_direction);
            h.add_debug(focus);
        }
    }
    let Links { lit, blockers } = links;
    for linked in [lit, blockers] {
        match linked {
            Linked::All => h.add_str("all"),
            Linked::Only(members) => h.add_slice(members),
        }
    }
    add_light_shape(h, scene, shape)
}

/// Adds where a light is, and how large; returns its strength.
fn add_light_shape(h: &mut Hasher, scene: &Scene, shape: &LightShape) -> Rgb {
    let mut add = |what: &str, vectors: &[Vec3], numbers: &[Option<f32>]| {
        h.add_str(what);
        h.add_slice(vectors);
        h.add_debug(&numbers);
    };
    match shape {
        LightShape::Point { position, intensity, range } => {
            add("point", &[*position], &[*range]);
            *intensity
        }
        LightShape::Spot { position, direction, intensity, inner, outer, range } => {
            add("spot", &[*position, *direction], &[Some(*inner), Some(*outer), *range]);
            *intensity
        }
        LightShape::Directional { direction, illuminance, angle } => {
            add("directional", &[*direction], &[Some(*angle)]);
            *illuminance
        }
        LightShape::Rect { center, u, v, radiance } => {
            add("rect", &[*center, *u, *v], &[]);
            *radiance
        }
        LightShape::Disk { center, u, v, radiance } => {
            add("disk", &[*center, *u, *v], &[]);
            *radiance
        }
        LightShape::Sphere { world_from_unit, radiance } => {
            h.add_str("sphere");
            h.add_slice(&world_from_unit.to_cols_array());
            *radiance
        }
        LightShape::Cylinder { world_from_unit, radiance } => {
            h.add_str("cylinder");
            h.add_slice(&world_from_unit.to_cols_array());
            *radiance
        }
        LightShape::Portal { center, u, v, sky } => {
            add("portal", &[*center, *u, *v], &[]);
            if sky.others.is_empty() {
                return add_sky(h, scene, sky);
            }
            for sky in sky.each() {
                let radiance = add_sky(h, scene, sky);
                h.add_slice(&radiance.to_array());
            }
            Rgb::ONE
        }
    }
}

/// Adds a sky without the others that it holds; returns its strength.
fn add_sky(h: &mut Hasher, scene: &Scene, sky: &Environment) -> Rgb {
    let Environment { name: _, radiance, texture, world_from_sky, contribution: _, others: _ } = sky;
    match texture {
        // The same from everywhere, however it is turned.
        None => h.add_str("constant"),
        Some(texture) => {
            add_picture(h, scene, *texture);
            add_matrix(h, world_from_sky);
        }
    }
    *radiance
}

/// Adds what an emissive material shines with, and from where; returns its strength.
fn add_emission(h: &mut Hasher, scene: &Scene, material: usize) -> Rgb {
    let slot = scene.materials[material].emission_texture.as_ref();
    add_slot(h, slot, Channels::Color, &Pictures::of(scene, [(slot, Channels::Color)]));
    let has_it = |mesh: &Mesh| mesh.triangle_material.contains(&(material as u32));
    let with_it: Vec<bool> = scene.meshes.par_iter().map(has_it).collect();
    let shines = |surface: &&Surface| surface.role.casts && with_it[surface.mesh];
    let bodies = Bodies::new(scene, scene.surfaces.iter().filter(shines).map(|surface| surface.mesh));
    for surface in scene.surfaces.iter().filter(shines) {
        h.add_key(bodies.surface(surface));
        let ordinal = bodies.0[&surface.mesh].materials.iter().position(|&m| m as usize == material);
        h.add_debug(&ordinal);
    }
    scene.materials[material].emission
}

fn add_picture(h: &mut Hasher, scene: &Scene, texture: usize) {
    h.add_key(picture(&scene.textures[texture], Channels::All));
}

fn add_profile(h: &mut Hasher, profile: &Profile) {
    let Profile { web, scale, angle_scale, web_from_light } = profile;
    let PhotometricWeb { name: _, kind, vertical, horizontal, candela, rated_lumens, tilt } = web.as_ref();
    h.add_debug(&(scale, angle_scale, kind, rated_lumens));
    add_matrix(h, web_from_light);
    for angles in [vertical, horizontal, candela] {
        h.add_slice(angles);
    }
    h.add_slice(tilt);
}

fn add_matrix(h: &mut Hasher, matrix: &Mat3) {
    h.add_slice(&matrix.to_cols_array());
}
