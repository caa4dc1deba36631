//! UDIM: one picture in many files, tile 1001 + column + 10 * row over the unit square at (column, row), v up.
//!
//! A material with such pictures becomes one material for each tile that its faces lie in. A face lies in the tile of the
//! middle of its UVs: by convention none crosses a border.

use super::read::Reading;
use super::texture::Textures;
use crate::scene::{Material, Mesh, TextureSlot, Wrap};
use glam::{Affine2, Vec2};
use openusd::ar::{ResolvedPath, Resolver};
use openusd::sdf::AssetPath;
use openusd::usd::Prim;
use std::collections::HashMap;

/// Columns, and rows that are looked for.
const COLUMNS: u32 = 10;
const ROWS: u32 = 10;

const MARKS: [&str; 2] = ["<UDIM>", "<udim>"];

/// True where `name` stands for many files.
pub fn is_tiled(name: &str) -> bool {
    MARKS.iter().any(|mark| name.contains(mark))
}

/// The files that `name`, the value of the attribute `input` of `shader`, stands for and that are there.
pub fn files(resolver: &impl Resolver, shader: &Prim, input: &str, name: &str) -> Vec<([u32; 2], AssetPath)> {
    let sites = shader.prim_index().property_stack(format!("inputs:{input}")).unwrap_or_default();
    let layers = sites.iter().filter_map(|site| {
        let layer = shader.stage().layer(&site.layer)?;
        layer.resolved_path().map(ResolvedPath::new)
    });
    // A path on an interface is relative to the layer that it was said in, which is that of the input in all but odd cases.
    let anchors: Vec<Option<ResolvedPath>> = layers.map(Some).chain([None]).collect();
    let tiles = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| [column, row]));
    tiles
        .filter_map(|tile| {
            let number = (1001 + tile[0] + COLUMNS * tile[1]).to_string();
            let name = MARKS.iter().fold(name.to_owned(), |name, mark| name.replace(mark, &number));
            let found = anchors
                .iter()
                .find_map(|anchor| resolver.resolve(&resolver.create_identifier(&name, anchor.as_ref())))?;
            Some((tile, AssetPath::with_resolved_path(name, found.to_string_lossy().into_owned())))
        })
        .collect()
}

/// Gives each face of `mesh` the material of its tile; `materials` gets one for each tile that is met.
pub fn choose_tiles(mesh: &mut Mesh, materials: &mut Vec<Material>, textures: &Textures, reading: &mut Reading) {
    let is_tiled = |slot: &TextureSlot| textures.tiles.contains_key(&slot.texture);
    if textures.tiles.is_empty()
        || !mesh.triangle_material.iter().any(|&m| all_slots(&materials[m as usize]).any(is_tiled))
    {
        return;
    }
    let mut known: HashMap<(u32, Vec<[i32; 2]>), u32> = HashMap::new();
    let mut empty = 0usize;
    let mut first = 0;
    while first < mesh.triangles.len() {
        let of = |t: usize| (mesh.origin[t].part, mesh.origin[t].face);
        let end = (first..mesh.triangles.len()).find(|&t| of(t) != of(first)).unwrap_or(mesh.triangles.len());
        let index = mesh.triangle_material[first];
        let slots: Vec<&TextureSlot> = all_slots(&materials[index as usize]).collect();
        if slots.iter().any(|slot| is_tiled(slot)) {
            let tiles: Vec<[i32; 2]> = slots.iter().map(|slot| tile(mesh, first..end, slot)).collect();
            let made = *known.entry((index, tiles.clone())).or_insert_with(|| {
                let mut material = materials[index as usize].clone();
                empty += tiled_slots(&mut material, &tiles, textures);
                materials.push(material);
                materials.len() as u32 - 1
            });
            mesh.triangle_material[first..end].fill(made);
        }
        first = end;
    }
    if empty > 0 {
        let message = "UVs lie in tiles that a UDIM texture has no picture for; the colour without a texture is used";
        reading.add(format!("{} ({empty} tiles)", mesh.name), message);
    }
}

/// The tile, v up, of the middle of the UVs of `triangles`.
fn tile(mesh: &Mesh, triangles: std::ops::Range<usize>, slot: &TextureSlot) -> [i32; 2] {
    let Some(uvs) = mesh.uv_set(&slot.uv_set) else { return [0, 0] };
    let corners = mesh.triangles[triangles].iter().flatten();
    let (sum, count) = corners.fold((Vec2::ZERO, 0.0), |(sum, count), &v| (sum + uvs[v as usize], count + 1.0));
    let middle = slot.image_from_uv.transform_point2(sum / f32::max(count, 1.0));
    [middle.x.floor() as i32, (1.0 - middle.y).floor() as i32]
}

/// The textures in use, those of the appearance last.
fn all_slots(material: &Material) -> impl Iterator<Item = &TextureSlot> {
    material.slots().chain(material.appearance.iter().flat_map(|look| look.slots()))
}

/// Gives the tiled slots of `material` their tiles' pictures; the number of those without one.
fn tiled_slots(material: &mut Material, tiles: &[[i32; 2]], textures: &Textures) -> usize {
    let mut empty = 0;
    let mut tiles = tiles.iter();
    let mut choose = |slot: &mut TextureSlot| {
        let has_picture = tiles.next().is_none_or(|tile| choose_tile(slot, *tile, textures));
        empty += usize::from(!has_picture);
        has_picture
    };
    let slots = [
        &mut material.albedo_texture,
        &mut material.emission_texture,
        &mut material.opacity_texture,
        &mut material.transmission_texture,
    ];
    for place in slots {
        if place.as_mut().is_some_and(|slot| !choose(slot)) {
            *place = None;
        }
    }
    if let Some(look) = &mut material.appearance {
        look.retain_slots(choose);
    }
    empty
}

/// Gives `slot` the picture of `tile`; false where there is none.
fn choose_tile(slot: &mut TextureSlot, tile: [i32; 2], textures: &Textures) -> bool {
    let Some(pictures) = textures.tiles.get(&slot.texture) else { return true };
    let picture = match tile.map(u32::try_from) {
        [Ok(column), Ok(row)] => pictures.get(&[column, row]),
        _ => None,
    };
    let Some(&picture) = picture else { return false };
    slot.texture = picture;
    // To the unit square; the scene's v points down.
    let shift = Vec2::new(-tile[0] as f32, tile[1] as f32);
    slot.image_from_uv = Affine2::from_translation(shift) * slot.image_from_uv;
    slot.wrap = [Wrap::Clamp; 2];
    true
}
