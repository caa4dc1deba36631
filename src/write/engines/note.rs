//! The note beside a result: how an engine loads it, with the names and numbers of this bake.

use super::{Engine, Vertical, rectangle};
use crate::post::{Directional, PageImage, Quantity};
use crate::scene::SurfaceOrigin;
use crate::write::Baked;
use crate::write::encode::{Encoded, Encoding};
use std::fmt::Write;

/// Rectangles that are listed; the others stand in the report.
const MOST_ROWS: usize = 24;

/// Mean of the covered texels and the largest value of any channel.
fn levels(pages: &[PageImage]) -> (f64, f32) {
    let (mut sum, mut weight, mut largest) = (0.0f64, 0.0f64, 0.0f32);
    for (color, coverage) in pages.iter().flat_map(|p| p.rgb.iter().zip(&p.coverage)) {
        sum += f64::from(crate::color::luminance(*color)) * f64::from(*coverage);
        weight += f64::from(*coverage);
        largest = largest.max(color.max_element());
    }
    (if weight > 0.0 { sum / weight } else { 0.0 }, largest)
}

/// What a note tells besides what a bake holds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told<'a> {
    /// The GLB for engines beside it, where one was written.
    pub glb: Option<&'a str>,
    /// True where some OpenEXR page is of 32-bit floats.
    pub float: bool,
    pub directional: Directional,
    /// True where light probes were written.
    pub probes: bool,
}

/// The note's text.
pub fn note(engine: Engine, baked: &Baked, told: &Told) -> String {
    let mut text = String::new();
    let scene = baked.source.path().file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    // Writing to a String does not fail.
    let glb = told.glb;
    let _ = head(&mut text, engine, baked, &scene, told);
    if let Some(file) = baked.encoded.iter().find(|e| e.encoding == engine.encoding()).or(baked.encoded.first()) {
        let _ = steps(&mut text, engine, baked.quantity, file, glb.unwrap_or("the GLB"), told.float);
    }
    let _ = beside(&mut text, engine, baked, told);
    let _ = rectangles(&mut text, engine, baked);
    text
}

/// Files, quantity and levels.
fn head(text: &mut String, engine: Engine, baked: &Baked, scene: &str, told: &Told) -> std::fmt::Result {
    writeln!(text, "{scene}, baked for {}", engine.title())?;
    writeln!(text)?;
    if let Some(glb) = told.glb {
        writeln!(text, "geometry   {glb}: lightmap UVs in a set of their own (extras.lumel.texCoord of each node)")?;
    }
    for form in baked.encoded {
        for (uri, [width, height]) in form.uris.iter().zip(&baked.atlas.pages) {
            writeln!(text, "page       {uri}: {width} x {height}, {}", decode(form, told.float))?;
        }
    }
    let what = match baked.quantity {
        Quantity::Outgoing => "E / pi [nit]: what a white wall sends out; to be multiplied by the albedo alone",
        Quantity::Irradiance => "E [lx]: to be multiplied by the albedo over pi",
        Quantity::Radiosity => "B [lm/m^2]: the albedo is in it; over pi it is what a wall sends out",
    };
    writeln!(text, "quantity   {what}")?;
    if let Some(lightmap) = baked.lightmap {
        let (mean, largest) = levels(&lightmap.pages);
        let unit = baked.quantity.unit();
        writeln!(text, "levels     {mean:.4} {unit} on average, {largest:.4} {unit} at most")?;
    }
    writeln!(text, "filter     bilinear, clamped; the gutters hold {} texel(s)", baked.atlas.padding)?;
    writeln!(
        text,
        "lights     those that are baked carry extras.lumel.baked: leave them out, or they light the scene twice"
    )?;
    writeln!(text)
}

/// How a file's texels become values.
fn decode(form: &Encoded, float: bool) -> String {
    let scale = form.scale;
    let scaled = |formula: &str| if scale == 1.0 { formula.to_string() } else { format!("{scale} * {formula}") };
    match form.encoding {
        Encoding::Exr if float => "OpenEXR, 32-bit floats where half floats don't do, linear, coverage in alpha".into(),
        Encoding::Exr => "OpenEXR, half floats, linear, coverage in alpha".into(),
        Encoding::Hdr => "Radiance HDR, linear".into(),
        Encoding::Rgbm => format!("RGBM: {}", scaled("(8 A RGB)^2")),
        Encoding::RgbmSrgb => format!("RGBM: {}", scaled("linear_from_srgb(8 A RGB)")),
        Encoding::Rgbd => format!("RGBD: {}", scaled("RGB^2.2 / A")),
        Encoding::Ktx2Half => format!("KTX2 of half floats, {}, coverage in alpha", scaled("RGB")),
        Encoding::Ktx2Bc6h => format!("KTX2 of BC6H blocks, {}", scaled("RGB")),
    }
}

/// What to do in the engine.
fn steps(
    text: &mut String,
    engine: Engine,
    quantity: Quantity,
    file: &Encoded,
    glb: &str,
    float: bool,
) -> std::fmt::Result {
    let page = file.uris.first().map_or("the page", String::as_str);
    let Some(intensity) = engine.intensity(quantity) else {
        return writeln!(
            text,
            "Radiosity holds the albedo already and no lightmap slot fits it: show it as emission, over pi, on black.\n"
        );
    };
    // Decoding leaves the scale to the engine's own factor.
    let factor = intensity * file.scale;
    let lines = match engine {
        Engine::Bevy => bevy(glb, page, factor),
        Engine::Three => three(glb, page, factor, file.encoding, float),
        Engine::Playcanvas => playcanvas(glb, page, factor),
        Engine::Babylon => babylon(glb, page, factor),
        Engine::Unity => unity(glb, page, factor),
        Engine::Unreal => unreal(glb, page, factor),
        Engine::Godot => godot(glb, page, factor),
        Engine::Blender => blender(glb, page, factor),
        Engine::Needle => format!(
            "Open {glb} in Needle Engine: it names its pages (NEEDLE_lightmaps) and rectangles itself. A lit wall shows its luminance\n\
             over {factor}: multiply the renderer's toneMappingExposure by it where lights of the engine's own shine beside."
        ),
        Engine::Hubs => {
            format!(
                "Put {glb} and {page} into a scene as they are: MOZ_lightmap names the pages and their intensity, {factor}."
            )
        }
    };
    writeln!(text, "{lines}\n")
}

fn bevy(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Load {glb} with GltfPlugin. For each node's primitive, with the rectangle below (extras arrive as the component GltfExtras), insert\n\
         \x20   Lightmap {{ image: assets.load(\"{page}\"), uv_rect: Rect {{ min: offset, max: offset + scale }}, bicubic_sampling: false }}\n\
         and set on its StandardMaterial\n\
         \x20   lightmap_exposure = {factor}\n\
         What is shown is albedo * texel * lightmap_exposure * the camera's exposure, in which Bevy's lights are too. Set\n\
         affects_lightmapped_mesh_diffuse of baked lights and affects_lightmapped_meshes of ambient light to false: both are true by default.\n\
         Bevy keeps rectangles in 16 bits; on pages of 8192 texels and more, bake UVs of the page itself (--gltf-lightmap-ext moz)."
    )
}

fn three(glb: &str, page: &str, factor: f32, encoding: Encoding, float: bool) -> String {
    let loader = match encoding {
        Encoding::Hdr => "HDRLoader",
        Encoding::Ktx2Half | Encoding::Ktx2Bc6h => "KTX2Loader",
        Encoding::Exr if float => "EXRLoader after setDataType(THREE.FloatType), as half floats would clip them",
        _ => "EXRLoader",
    };
    // The loaders of EXR and HDR put row 0 at the bottom.
    let (sign, offset) = if encoding.has_mips() { ("", "offset.y") } else { ("-", "1 - offset.y") };
    format!(
        "Load {glb} with GLTFLoader and {page} with {loader}. For each node with userData.lumel, on a clone of its texture and material:\n\
         \x20   texture.channel = lumel.texCoord; texture.repeat.set(scale.x, {sign}scale.y); texture.offset.set(offset.x, {offset})\n\
         \x20   material.lightMap = texture; material.lightMapIntensity = {factor}\n\
         MeshLambertMaterial and MeshBasicMaterial show albedo * E / pi. MeshStandardMaterial takes off what its dielectric coat\n\
         reflects, 2 to 5 %; a MeshPhysicalMaterial with specularIntensity 0 does not."
    )
}

fn playcanvas(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Load {glb}. Load {page} as a texture of type pc.TEXTURETYPE_RGBM, clamped, without mipmaps. For each node, on a clone of its\n\
         material, with the rectangle below:\n\
         \x20   material.lightMap = texture; material.lightMapUv = 1\n\
         \x20   material.lightMapTiling = (x, y); material.lightMapOffset = (z, w)\n\
         What is shown is albedo * decoded texel; times {factor}, which the camera's exposure can take, it is nit."
    )
}

fn babylon(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Load {glb}. Load {page} with new Texture(url, scene, true, false) (no mipmaps, not turned over), one for each node, and set\n\
         \x20   texture.isRGBD = true; texture.gammaSpace = false; texture.coordinatesIndex = 1; texture.level = {factor}\n\
         \x20   texture.uScale, vScale, uOffset, vOffset = the rectangle below, with uRotationCenter and vRotationCenter 0\n\
         On a clone of its PBRMaterial: lightmapTexture = texture; useLightmapAsShadowmap = true; ambientColor = white; and\n\
         scene.ambientColor = white: the ambient term gives the albedo, and the lightmap multiplies it. Without\n\
         useLightmapAsShadowmap Babylon.js adds the page to the colour, and the albedo is lost."
    )
}

fn unity(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Import {glb} (importers turn v up) and {page} as texture type Lightmap, uncompressed or BC6H. Then\n\
         \x20   LightmapSettings.lightmapsMode = NonDirectional; LightmapSettings.lightmaps = one LightmapData a page, lightmapColor = the page\n\
         \x20   renderer.lightmapIndex = page; renderer.lightmapScaleOffset = (x, y, z, w) of the rectangles below\n\
         Unity multiplies texels by the albedo alone. Multiply pages by {factor}, and by the exposure that your lights are set up for; in\n\
         HDRP with physical units they are nit as they stand."
    )
}

fn unreal(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Import {glb} by Interchange, and {page} as a texture: HDR or BC6H, no sRGB, no mips, clamped. Unreal Engine takes no lightmaps of\n\
         others in its own slot: give surfaces an unlit material, an instance each with the rectangle below as a vector parameter, with\n\
         \x20   emissive = base colour * page(UV1 * (x, y) + (z, w)) * {factor}\n\
         Emissive is in nit, as the page is."
    )
}

fn godot(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Import {glb} (TEXCOORD_1 arrives as UV2) and {page} (not VRAM compressed, mipmaps off). LightmapGI reads only what it baked\n\
         itself: give surfaces a ShaderMaterial of render_mode unshaded, the rectangle below as an instance uniform, with\n\
         \x20   uniform sampler2D page : filter_linear, repeat_disable;  instance uniform vec4 rectangle;\n\
         \x20   ALBEDO = albedo.rgb * texture(page, UV2 * rectangle.xy + rectangle.zw).rgb * {factor};\n\
         Set the camera's exposure for nit, or divide by the level that should be white."
    )
}

fn blender(glb: &str, page: &str, factor: f32) -> String {
    format!(
        "Import {glb}. In each material: UV Map node (UVMap.001) -> Mapping (scale x, y; location z, w of the rectangles below) ->\n\
         Image Texture {page} (Non-Color, Linear, Extend) -> times the base colour -> Emission of strength {factor}. View transform Standard."
    )
}

/// How layers and light probes are read: no engine takes them by itself.
fn beside(text: &mut String, engine: Engine, baked: &Baked, told: &Told) -> std::fmt::Result {
    let layers = baked.lightmap.map_or(&[][..], |lightmap| &lightmap.layers);
    if let Some(formula) = told.directional.formula() {
        writeln!(
            text,
            "directions {formula}. They are channels of the OpenEXR pages; the RGB of the pages needs none of them, and a"
        )?;
        writeln!(text, "           shader of your own that knows normal maps reads value(n) in its place.")?;
    }
    let names: Vec<&str> = layers.iter().map(|layer| layer.name.as_str()).collect();
    if !names.is_empty() {
        writeln!(
            text,
            "layers     {}: channels LAYER.R, .G, .B (or .Y, or .X, .Y, .Z) of the OpenEXR pages, by",
            names.join(", ")
        )?;
        writeln!(
            text,
            "           the same UVs and rectangles; image importers read the first RGB alone: split them beforehand."
        )?;
    }
    if told.probes {
        let [json, exr] = crate::write::probes::FILES;
        writeln!(
            text,
            "probes     {json} says where each stands and what it holds (spherical harmonics, metres, right-handed, Y up), {exr}"
        )?;
        writeln!(
            text,
            "           holds the same as a picture. Set them by a script: no engine imports them by itself."
        )?;
    }
    if told.directional != Directional::Off || !names.is_empty() || told.probes {
        if engine == Engine::Unity {
            writeln!(
                text,
                "           Unity's space is left-handed: mirror n and positions as the importer does (glTFast: x)."
            )?;
        }
        writeln!(text)?;
    }
    Ok(())
}

/// The rectangles of surfaces.
fn rectangles(text: &mut String, engine: Engine, baked: &Baked) -> std::fmt::Result {
    let vertical = engine.vertical();
    let way = if vertical == Vertical::Up { "up" } else { "down" };
    writeln!(text, "rectangles: page UV = lightmap UV * (x, y) + (z, w), v {way}")?;
    let shown: Vec<usize> = (0..baked.scene.surfaces.len()).filter(|s| baked.atlas.is_shown(*s)).collect();
    for &surface in shown.iter().take(MOST_ROWS) {
        let placement = &baked.atlas.placements[surface];
        let [x, y, z, w] = rectangle(placement, vertical);
        let s = &baked.scene.surfaces[surface];
        let node = match s.origin {
            SurfaceOrigin::GltfNode(node) => format!("{} (node {node})", s.name),
            _ => s.name.clone(),
        };
        writeln!(text, "    page {}  {x} {y} {z} {w}  {node}", placement.page)?;
    }
    if shown.len() > MOST_ROWS {
        let more = shown.len() - MOST_ROWS;
        let turned = if vertical == Vertical::Up { " (v down there: w = 1 - y - w)" } else { "" };
        writeln!(text, "    and {more} more, in report.json and in the extras of the GLB's nodes{turned}")?;
    }
    Ok(())
}
