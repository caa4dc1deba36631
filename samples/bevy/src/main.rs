//! Shows a level that was baked with `lumel bake SCENE --for bevy`: reads pages and rectangles from the GLB's extras and inserts
//! `Lightmap` components.
//!
//!     lumel bake ../cornell_box/cornell_box.glb --for bevy -o baked
//!     cargo run -- baked/cornell_box.glb [EV100]

use bevy::camera::Exposure;
use bevy::core_pipeline::tonemapping::Tonemapping;
use bevy::gltf::GltfExtras;
use bevy::pbr::Lightmap;
use bevy::prelude::*;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// EV100 of the exposure 1, at which a radiance of 1 nit is shown as 1: 2^-EV / 1.2 = 1.
const UNIT_EV100: f32 = -0.263;

/// `asset.extras.lumel`: what the whole bake holds.
#[derive(Clone, Debug, Deserialize)]
struct Bake {
    quantity: String,
    pages: Vec<Page>,
    /// Forms that pages were written in.
    #[serde(default)]
    encodings: Vec<Form>,
}

/// A form of the pages: decoded texels times `scale` are the values.
#[derive(Clone, Debug, Deserialize)]
struct Form {
    scale: f32,
    uris: Vec<String>,
}

#[derive(Clone, Debug, Deserialize)]
struct Page {
    uri: String,
}

/// `extras.lumel` of a node: where its light lies.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Placement {
    page: usize,
    tex_coord: usize,
    scale: [f32; 2],
    offset: [f32; 2],
}

/// The pages, and the factor that makes E / pi [nit] of their texels.
#[derive(Resource)]
struct Pages {
    images: Vec<Handle<Image>>,
    exposure: f32,
}

/// What to show.
#[derive(Resource)]
struct Shown {
    glb: PathBuf,
    bake: Bake,
    ev100: f32,
}

fn main() -> Result {
    let mut arguments = std::env::args().skip(1);
    let glb = PathBuf::from(arguments.next().ok_or("usage: lumel-bevy BAKED.glb [EV100]")?);
    let ev100 = arguments.next().map_or(Ok(UNIT_EV100), |text| text.parse())?;
    let folder = glb.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).canonicalize()?;
    let bake = read_bake(&glb)?;
    App::new()
        .add_plugins(DefaultPlugins.set(AssetPlugin { file_path: folder.display().to_string(), ..default() }))
        .insert_resource(Shown { glb, bake, ev100 })
        // The light is in the pages.
        .insert_resource(GlobalAmbientLight::NONE)
        .add_systems(Startup, open)
        .add_systems(Update, (insert_lightmaps, quench_lights, expose_cameras))
        .run();
    Ok(())
}

/// The extras of the GLB's asset, which Bevy doesn't hand out: the JSON chunk stands at the file's start.
fn read_bake(glb: &Path) -> Result<Bake> {
    let bytes = std::fs::read(glb)?;
    let size = bytes.get(12..16).ok_or("is no GLB")?.try_into().map(u32::from_le_bytes)? as usize;
    let json: serde_json::Value = serde_json::from_slice(bytes.get(20..20 + size).ok_or("is no GLB")?)?;
    let lumel = json.pointer("/asset/extras/lumel").ok_or("was not baked by Lumel")?;
    Ok(Bake::deserialize(lumel)?)
}

fn open(mut commands: Commands, shown: Res<Shown>, assets: Res<AssetServer>) -> Result {
    let exposure = match shown.bake.quantity.as_str() {
        "outgoing" => 1.0,
        "irradiance" => std::f32::consts::FRAC_1_PI,
        other => return Err(format!("{other} holds the albedo already; bake with --for bevy").into()),
    };
    let first = shown.bake.pages.first().map(|page| &page.uri);
    let form = shown.bake.encodings.iter().find(|form| form.uris.first() == first);
    let exposure = exposure * form.map_or(1.0, |form| form.scale);
    let images = shown.bake.pages.iter().map(|page| assets.load(page.uri.clone())).collect();
    commands.insert_resource(Pages { images, exposure });
    let name = shown.glb.file_name().ok_or("is no file")?.to_string_lossy().into_owned();
    commands.spawn(WorldAssetRoot(assets.load(GltfAssetLabel::Scene(0).from_asset(name))));
    Ok(())
}

/// Gives the meshes of each node its page, and a material of their own with the lightmap's exposure.
fn insert_lightmaps(
    mut commands: Commands,
    pages: Res<Pages>,
    nodes: Query<(&GltfExtras, &Children), Added<GltfExtras>>,
    meshes: Query<&MeshMaterial3d<StandardMaterial>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
) {
    for (extras, children) in &nodes {
        let extras: Option<serde_json::Value> = serde_json::from_str(&extras.value).ok();
        let Some(place) = extras.and_then(|e| Placement::deserialize(e.get("lumel")?).ok()) else { continue };
        if place.tex_coord != 1 {
            warn!("Bevy reads lightmaps by TEXCOORD_1, and a node's UVs are TEXCOORD_{}", place.tex_coord);
        }
        let Some(image) = pages.images.get(place.page) else { continue };
        let (offset, scale) = (Vec2::from_array(place.offset), Vec2::from_array(place.scale));
        for child in children.iter() {
            // Child nodes are children too; only primitives have materials.
            let Ok(MeshMaterial3d(shared)) = meshes.get(child) else { continue };
            let Some(mut own) = materials.get(shared).cloned() else { continue };
            own.lightmap_exposure = pages.exposure;
            commands.entity(child).insert((
                MeshMaterial3d(materials.add(own)),
                Lightmap { image: image.clone(), uv_rect: Rect { min: offset, max: offset + scale }, ..default() },
            ));
        }
    }
}

/// Lights that are baked go on shining on what has no lightmap, and in highlights.
fn quench_lights(
    mut points: Query<&mut PointLight, Added<PointLight>>,
    mut spots: Query<&mut SpotLight, Added<SpotLight>>,
    mut suns: Query<&mut DirectionalLight, Added<DirectionalLight>>,
) {
    points.iter_mut().for_each(|mut light| light.affects_lightmapped_mesh_diffuse = false);
    spots.iter_mut().for_each(|mut light| light.affects_lightmapped_mesh_diffuse = false);
    suns.iter_mut().for_each(|mut light| light.affects_lightmapped_mesh_diffuse = false);
}

/// The file's cameras show nit by the exposure asked for, without a film curve.
fn expose_cameras(mut commands: Commands, shown: Res<Shown>, cameras: Query<Entity, Added<Camera3d>>) {
    for camera in &cameras {
        commands.entity(camera).insert((Exposure { ev100: shown.ev100 }, Tonemapping::None));
    }
}
