//! The scene's postconditions, checked once after loading.

use super::Scene;
use crate::error::{Error, Result, Warnings};

/// Drops what later stages can't use (degenerate triangles, surfaces without any, triangles with numbers that are not
/// finite, media at fault), each counted as a warning, and checks every index.
///
/// # Errors
/// `Invalid` where an index is out of range or a scene without any surface is left; `place` names the file.
pub fn validate(scene: &mut Scene, place: &str, warnings: &mut Warnings) -> Result<()> {
    for mesh in &mut scene.meshes {
        let vertices = mesh.positions.len();
        let lengths_agree = (mesh.normals.is_empty() || mesh.normals.len() == vertices)
            && (mesh.colors.is_empty() || mesh.colors.len() == vertices)
            && mesh.uvs.iter().all(|s| s.coords.len() == vertices)
            && mesh.triangle_material.len() == mesh.triangles.len()
            && mesh.origin.len() == mesh.triangles.len();
        let in_range = mesh.triangles.iter().flatten().all(|&v| (v as usize) < vertices)
            && mesh.triangle_material.iter().all(|&m| (m as usize) < scene.materials.len());
        if !lengths_agree || !in_range {
            return Err(Error::invalid(
                format!("{place}: {}", mesh.name),
                "indices are out of range; export the mesh again",
            ));
        }
        let mut keep = Vec::with_capacity(mesh.triangles.len());
        let (mut degenerate, mut not_finite) = (0usize, 0usize);
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            let finite = a.is_finite() && b.is_finite() && c.is_finite();
            let sound = finite && is_sound(a, b, c);
            not_finite += usize::from(!finite);
            degenerate += usize::from(finite && !sound);
            keep.push(sound);
        }
        if degenerate > 0 {
            warnings.add(format!("{} ({degenerate})", mesh.name), "degenerate triangles were left out");
        }
        if not_finite > 0 {
            warnings
                .add(format!("{} ({not_finite})", mesh.name), "triangles with infinite or NaN positions were left out");
        }
        retain(&mut mesh.triangles, &keep);
        retain(&mut mesh.triangle_material, &keep);
        retain(&mut mesh.origin, &keep);
    }
    let meshes = &scene.meshes;
    let mut keep = Vec::with_capacity(scene.surfaces.len());
    for s in &scene.surfaces {
        let transform = s.world_from_local;
        let placed = transform.is_finite() && transform.matrix3.determinant() != 0.0;
        if !placed {
            warnings.add(&s.name, "the transform is not invertible; the surface was left out");
        }
        keep.push(placed && !meshes[s.mesh].triangles.is_empty());
    }
    scene.retain_surfaces(&keep);
    if scene.surfaces.is_empty() {
        let mut message = "the scene holds no triangles to bake".to_owned();
        // What was left out is likely the reason.
        let left_out: Vec<&str> = warnings.iter().take(3).map(|w| w.message.as_str()).collect();
        if !left_out.is_empty() {
            message += &format!(" ({})", left_out.join("; "));
        }
        return Err(Error::invalid(place, message));
    }
    let media = std::mem::take(&mut scene.media);
    for medium in media {
        match medium.fault(scene) {
            Some(fault) => warnings.add(&medium.name, format!("a medium was left out: {fault}")),
            None => scene.media.push(medium),
        }
    }
    Ok(())
}

/// A triangle with a usable normal: its height is more than 1e-6 of its longest edge.
fn is_sound(a: glam::Vec3, b: glam::Vec3, c: glam::Vec3) -> bool {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    longest > 0.0 && (b - a).cross(c - a).length() > 1e-6 * longest
}

fn retain<T: Copy>(items: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    items.retain(|_| *keep.next().expect("one flag an item"));
}
