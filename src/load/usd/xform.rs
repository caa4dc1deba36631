//! Local transforms: the xformOp stack.

use super::read::{self, Reading};
use glam::{DMat3, DMat4, DVec3};
use openusd::usd::{Prim, ResolveInfoSource, TimeCode};
use openusd_schemas::geom::{Xformable, XformableExt};

/// A prim's own transform.
pub struct LocalXform {
    pub parent_from_local: DMat4,
    /// The parent's transform doesn't apply (`!resetXformStack!`).
    pub resets: bool,
}

impl LocalXform {
    const IDENTITY: Self = Self { parent_from_local: DMat4::IDENTITY, resets: false };
}

/// The transform of `prim` at the reading's time code; without one at the default time, each op at its earliest sample where
/// it has no default. A stack that can't
/// be read counts as none, with a warning.
pub fn local_xform(prim: &Prim, warnings: &mut Reading) -> LocalXform {
    let moment = warnings.time;
    let read = |warnings: &mut Reading| -> Result<LocalXform, openusd_schemas::SchemaError> {
        let xformable = match Xformable::from_prim(prim.clone())? {
            Some(xformable) => xformable,
            None if is_xformable_elsewhere(prim) => Xformable::from_prim_unchecked(prim.clone()),
            None => return Ok(LocalXform::IDENTITY),
        };
        let (ops, resets) = xformable.ordered_xform_ops()?;
        let mut parent_from_local = DMat4::IDENTITY;
        let mut ops = ops.iter().peekable();
        while let Some(op) = ops.next() {
            // A pivot and its inverse side by side cancel, even where the matrix has no inverse.
            let next_undoes =
                ops.peek().is_some_and(|next| next.name() == op.name() && next.is_inverse_op() != op.is_inverse_op());
            if next_undoes {
                ops.next();
                continue;
            }
            if op.kind().is_none() {
                warnings.add(prim.path(), format!("unknown transform op {} was left out", op.name()));
                continue;
            }
            let default = op.attribute().resolve_info_at(None)?.source() == ResolveInfoSource::Default;
            let time = moment.or((!default).then_some(TimeCode::EARLIEST));
            // USD lists ops outermost first, as column-vector products are written.
            parent_from_local *= read::to_matrix(&op.op_transform(time)?);
        }
        Ok(LocalXform { parent_from_local, resets })
    };
    read(warnings).unwrap_or_else(|error| {
        warnings.add(prim.path(), format!("the transform could not be read and was left out: {error}"));
        LocalXform::IDENTITY
    })
}

/// True for prims that schemas beyond ours let be transformed: those of UsdSkel and UsdVol.
fn is_xformable_elsewhere(prim: &Prim) -> bool {
    const TYPES: [&str; 4] = ["SkelRoot", "Skeleton", "Volume", "ParticleField"];
    prim.type_name().ok().flatten().is_some_and(|kind| TYPES.contains(&kind.as_str()))
}

/// Metres and Y up from the stage's own unit and axis.
pub fn metres_from_stage(metres_per_unit: f64, z_up: bool) -> DMat4 {
    let y_up_from_stage = if z_up { DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y) } else { DMat3::IDENTITY };
    DMat4::from_mat3(y_up_from_stage * metres_per_unit)
}
