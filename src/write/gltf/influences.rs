//! Influences of joints on new vertices: `JOINTS_n` and `WEIGHTS_n` of glTF 2.0, section 3.7.3.3.
//!
//! A vertex between others is moved by the joints of all of them, each by its weights blended. Of those the strongest are kept, as
//! many as the source has room for, and made to add up to 1; quantized weights add up to full scale exactly.

use super::accessor::{self, Blending, Elements};
use super::document::Document;
use crate::error::{Error, Result};
use crate::write::blend::Blend;
use crate::write::split::Sources;
use std::collections::BTreeMap;

/// Joints and weights of four influences a vertex.
struct Set {
    names: [String; 2],
    joints: Elements,
    weights: Elements,
}

/// Writes the influences of the vertices `sources`, from the accessors that `attributes` name; returns the new accessors by the
/// attributes' names, none where the source has no skin.
///
/// # Errors
/// `Invalid` where the accessors are broken.
pub fn write(doc: &mut Document, attributes: &[(String, usize)], sources: &Sources) -> Result<BTreeMap<String, usize>> {
    let accessor_of = |name: &str| attributes.iter().find(|(n, _)| n == name).map(|(_, accessor)| *accessor);
    let mut sets = Vec::new();
    for number in 0.. {
        let names = [format!("JOINTS_{number}"), format!("WEIGHTS_{number}")];
        let (Some(joints), Some(weights)) = (accessor_of(&names[0]), accessor_of(&names[1])) else { break };
        let (joints, weights) = (accessor::read(doc, joints)?, accessor::read(doc, weights)?);
        let is_whole = joints.width() == 4 && weights.width() == 4 && joints.count() == weights.count();
        if !is_whole || sources.iter().any(|s| s.terms().any(|(v, _)| v as usize >= joints.count())) {
            let message = format!("{} and {} are broken; export the file again", names[0], names[1]);
            return Err(Error::invalid(&doc.place, message));
        }
        sets.push(Set { names, joints, weights });
    }
    let blended: Vec<Option<Vec<(u32, f64)>>> = sources.iter().map(|s| blend(&sets, &s)).collect();
    let mut written = BTreeMap::new();
    for (number, set) in sets.into_iter().enumerate() {
        // Whole vertices are copied; what the others get here is replaced.
        let (Some(mut joints), Some(mut weights)) =
            (set.joints.gather(sources, Blending::Strongest), set.weights.gather(sources, Blending::Strongest))
        else {
            continue;
        };
        for (i, influences) in blended.iter().enumerate() {
            let Some(influences) = influences else { continue };
            for c in 0..4 {
                let (joint, weight) = influences.get(4 * number + c).copied().unwrap_or((0, 0.0));
                joints.set_number(i, c, f64::from(joint));
                weights.set_number(i, c, weight * weights.one());
            }
        }
        let [name_of_joints, name_of_weights] = set.names;
        written.insert(name_of_joints, joints.push(doc));
        written.insert(name_of_weights, weights.push(doc));
    }
    Ok(written)
}

/// Joints of a blend and their weights, which add up to 1 in the numbers that the source has; `None` for a vertex of the source.
fn blend(sets: &[Set], source: &Blend) -> Option<Vec<(u32, f64)>> {
    if source.as_vertex().is_some() {
        return None;
    }
    let mut by_joint: BTreeMap<u32, f64> = BTreeMap::new();
    for (vertex, share) in source.terms() {
        for set in sets {
            for c in 0..4 {
                let weight = set.weights.number(vertex as usize, c) / set.weights.one();
                // NaN is no weight.
                if weight > 0.0 {
                    *by_joint.entry(set.joints.number(vertex as usize, c) as u32).or_default() += weight * share;
                }
            }
        }
    }
    let mut influences: Vec<(u32, f64)> = by_joint.into_iter().collect();
    // Of equal ones, the joint with the lower number: the sort is stable.
    influences.sort_by(|a, b| b.1.total_cmp(&a.1));
    influences.truncate(4 * sets.len());
    let total: f64 = influences.iter().map(|i| i.1).sum();
    influences.iter_mut().for_each(|i| i.1 /= total);
    let ones = sets.iter().filter(|set| !set.weights.is_float()).map(|set| set.weights.one());
    if let Some(one) = ones.reduce(f64::min).filter(|_| !influences.is_empty()) {
        quantize(&mut influences, one);
        influences.iter_mut().for_each(|i| i.1 /= one);
    }
    Some(influences)
}

/// Rounds weights that add up to 1 to whole numbers that add up to `one`: down, then up where most was lost.
fn quantize(influences: &mut Vec<(u32, f64)>, one: f64) {
    let mut lost: Vec<(usize, f64)> = Vec::with_capacity(influences.len());
    let mut rest = one;
    for (i, (_, weight)) in influences.iter_mut().enumerate() {
        let exact = *weight * one;
        *weight = exact.floor();
        rest -= *weight;
        lost.push((i, exact - *weight));
    }
    lost.sort_by(|a, b| b.1.total_cmp(&a.1));
    for (i, _) in lost.into_iter().take(rest.max(0.0) as usize) {
        influences[i].1 += 1.0;
    }
    // A joint without weight must be 0.
    influences.retain(|i| i.1 > 0.0);
}

#[cfg(test)]
mod tests {
    use super::quantize;

    #[test]
    fn quantized_weights_add_up() {
        for weights in [vec![1.0 / 3.0; 3], vec![0.999, 0.001], vec![0.25; 4], vec![0.5, 0.499, 0.001]] {
            let mut influences: Vec<(u32, f64)> = (0..).zip(weights.iter().copied()).collect();
            quantize(&mut influences, 255.0);
            assert_eq!(influences.iter().map(|i| i.1).sum::<f64>(), 255.0, "{influences:?}");
            for (joint, weight) in influences {
                assert!((weight - 255.0 * weights[joint as usize]).abs() < 1.0);
            }
        }
    }
}
