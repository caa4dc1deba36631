//! `lumel inspect`: what a bake would see, as tables or JSON.

use super::args::InspectArgs;
use super::config;
use super::console::Console;
use super::failure::Failure;
use super::print::{self, Table, count, number};
use lumel::color::{Rgb, luminance};
use lumel::inspect::{Inspection, LightInfo, SurfaceInfo, inspect as look};
use lumel::scene::BakeMode;

/// `lumel inspect`.
///
/// # Errors
/// `Usage` where the settings are wrong, else the loader's.
pub fn inspect(args: &InspectArgs, console: &Console) -> Result<(), Failure> {
    let settings = config::resolve(args)?.settings;
    let mut loaded = lumel::load::load_with(args.scene.path(), &settings.load_options())?;
    lumel::added_light::add(&mut loaded, &settings)?;
    let inspection = look(&loaded, &settings);
    if args.json {
        return print::json(&inspection);
    }
    print::print(&text(&inspection))?;
    console.warnings(&inspection.warnings);
    Ok(())
}

fn text(i: &Inspection) -> String {
    [surfaces(i), lights(i), totals(i)].join("\n")
}

fn surfaces(i: &Inspection) -> String {
    let heading = [
        "surface",
        "mesh",
        ">triangles",
        ">area [m^2]",
        ">texels/m",
        "role",
        ">albedo",
        "opacity",
        "materials",
        ">emits [lm]",
    ];
    let mut table = Table::new(&heading);
    for s in &i.surfaces {
        let [low, high] = s.albedo.map(|c| f64::from(luminance(Rgb::from_array(c))));
        let albedo = if (high - low).abs() < 5e-4 { format!("{low:.3}") } else { format!("{low:.3} - {high:.3}") };
        let power = if s.emissive_area > 0.0 { number(s.emissive_power) } else { String::new() };
        table.row(vec![
            s.name.clone(),
            s.mesh.clone(),
            count(s.triangles as u64),
            number(s.area),
            number(s.density),
            s.role.into(),
            albedo,
            opacity(s),
            s.materials.join(", "),
            power,
        ]);
    }
    let mut text = format!("surfaces: {}\n{}", i.surfaces.len(), table.text());
    if !i.shared_meshes.is_empty() {
        let mut shared = Table::new(&["mesh", ">surfaces"]);
        i.shared_meshes.iter().for_each(|m| shared.row(vec![m.name.clone(), count(m.surfaces as u64)]));
        text += &format!("\nshared meshes: {}\n{}", i.shared_meshes.len(), shared.text());
    }
    text
}

/// How much a surface lets through, where it isn't opaque.
fn opacity(s: &SurfaceInfo) -> String {
    let mut parts = Vec::new();
    let [low, high] = s.opacity.map(|o| number(f64::from(o)));
    if s.opacity != [1.0; 2] {
        parts.push(if low == high { low } else { format!("{low} - {high}") });
    }
    if s.masked {
        parts.push("masked".into());
    }
    let passes = luminance(Rgb::from_array(s.transmission));
    if passes > 0.0 {
        parts.push(format!("passes {}", number(f64::from(passes))));
    }
    parts.join(", ")
}

fn lights(i: &Inspection) -> String {
    let mut table = Table::new(&["light", "kind", ">R G B", "unit", ">area [m^2]", ">power [lm]", ""]);
    for l in &i.lights {
        let optional = |v: Option<f64>| v.map_or_else(String::new, number);
        let cells = [&l.name, l.kind, &triple(l.value, " "), l.unit, &optional(l.area), &optional(l.power), &notes(l)];
        table.row(cells.map(str::to_string).to_vec());
    }
    let mut text = format!("lights: {}\n{}", i.lights.len(), table.text());
    for e in &i.environment {
        let picture = e.texture.as_ref().map_or_else(String::new, |(name, [w, h])| format!(", {name}, {w} x {h}"));
        let part = part(e.bake, e.group.as_deref()).map_or_else(String::new, |part| format!(", {part}"));
        text += &format!("sky: {}, {} nit{picture}{part}\n", e.name, triple(e.radiance, " "));
    }
    if i.emissive_area > 0.0 {
        text += &format!("emissive: {} m^2, {} lm\n", number(i.emissive_area), number(i.emissive_power));
    }
    if !i.has_light {
        text += "nothing shines: a bake needs --sky, --sun or --environment\n";
    }
    text
}

/// What makes a light differ from its shape's.
fn notes(l: &LightInfo) -> String {
    let mut notes = Vec::new();
    if l.shaped {
        notes.push("shaped".to_string());
    }
    if let Some(p) = &l.profile {
        let rated = p.rated_lumens.map_or_else(String::new, |lm| format!(" of {} lm rated", number(lm)));
        notes.push(format!("profile {}, {} lm{rated}", p.name, number(p.power)));
    }
    if let Some(p) = &l.picture {
        let how = if p.thrown { "throws" } else { "shows" };
        let target = if p.keystone { ", square on its target" } else { "" };
        notes.push(format!("{how} {}, {} x {}{target}", p.name, p.size[0], p.size[1]));
    }
    if let Some(n) = l.lights_surfaces {
        notes.push(format!("lights {} surfaces", count(n as u64)));
    }
    if let Some(n) = l.blocking_surfaces {
        notes.push(format!("blocked by {} surfaces", count(n as u64)));
    }
    notes.extend(part(l.bake, l.group.as_deref()));
    notes.join("; ")
}

/// What of a light is baked and its group, where either is out of the ordinary.
fn part(bake: BakeMode, group: Option<&str>) -> Option<String> {
    let mode = match bake {
        BakeMode::Baked => None,
        BakeMode::Indirect => Some("indirect light alone is baked".to_string()),
        BakeMode::Dynamic => Some("dynamic: not baked".to_string()),
    };
    let parts: Vec<String> = mode.into_iter().chain(group.map(|group| format!("group {group}"))).collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}

fn totals(i: &Inspection) -> String {
    let [low, high] = i.bounds;
    let size = std::array::from_fn(|k| high[k] - low[k]);
    let e = &i.estimate;
    let mut table = Table::new(&["total", ""]);
    let mut row = |name: &str, value: String| table.row(vec![name.into(), value]);
    row("size", format!("{} m", triple(size, " x ")));
    row("bounds", format!("{} to {} m", triple(low, " "), triple(high, " ")));
    row("triangles", count(i.triangles as u64));
    row("area", format!("{} m^2", number(i.area)));
    row("density", format!("about {} texels per metre", number(e.density)));
    row("texels", format!("about {}", count(e.texels)));
    row(
        "pages",
        format!("about {} of up to {} x {}, {} at most", e.pages, e.page_size, e.page_size, i.limits.max_pages),
    );
    row("highest albedo", format!("{}, whiter ones are baked as this", i.limits.most_albedo));
    table.text()
}

fn triple(v: [f32; 3], between: &str) -> String {
    v.map(|v| number(f64::from(v))).join(between)
}
