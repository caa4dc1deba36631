//! Values of options that are more than a word or a number.

use lumel::pipeline::Weight;
use lumel::render::CameraChoice;
use lumel::settings::SkySetting;

/// A camera's name, or seven numbers.
pub fn parse_camera(text: &str) -> Result<CameraChoice, String> {
    let numbers: Result<Vec<f32>, _> = text.split(',').map(|v| v.trim().parse::<f32>()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z, to_x, to_y, to_z, angle]) if numbers.iter().flatten().all(|v| v.is_finite()) => {
            Ok(CameraChoice::At([x, y, z].into(), [to_x, to_y, to_z].into(), angle))
        }
        Ok(_) => Err("expected a name, or seven numbers: two places and an angle, as in 0,1.7,4,0,1,0,50".to_string()),
        Err(_) => Ok(CameraChoice::Named(text.to_string())),
    }
}

/// `width` or `widthxheight`.
pub fn parse_size(text: &str) -> Result<(u32, Option<u32>), String> {
    let side = |v: &str| v.trim().parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    let parts: Vec<Option<u32>> = text.split('x').map(side).collect();
    match parts[..] {
        [Some(width)] => Ok((width, None)),
        [Some(width), Some(height)] => Ok((width, Some(height))),
        _ => Err("expected pixels from 1 to 16384, as in 960 or 960x540".to_string()),
    }
}

/// An amount of memory, see [`lumel::settings::bytes`].
pub fn parse_bytes(text: &str) -> Result<u64, String> {
    lumel::settings::bytes::parse(text).ok_or_else(|| "expected bytes, as in 2G, 512M or 1048576".to_string())
}

/// See [`SkySetting`].
pub fn parse_sky(text: &str) -> Result<SkySetting, String> {
    text.parse()
}

/// `group=weight` or `group=r,g,b`.
pub fn parse_weight(text: &str) -> Result<Weight, String> {
    let (group, values) = text.rsplit_once('=').ok_or("expected a group and its weight, as in lamps=0.2")?;
    let values: Result<Vec<f32>, _> = values.split(',').map(|v| v.trim().parse::<f32>()).collect();
    let by = match values.as_deref() {
        Ok(&[v]) => [v; 3],
        Ok(&[r, g, b]) => [r, g, b],
        _ => return Err("expected one number or three, as in lamps=0.2 or sun=1,0.9,0.8".to_string()),
    };
    if by.iter().any(|v| !(0.0..=1e6).contains(v)) {
        return Err("a weight must lie within 0 and 1000000".to_string());
    }
    Ok(Weight { group: group.trim().to_string(), by: by.into() })
}

/// `elevation,azimuth,lux`.
pub fn parse_sun(text: &str) -> Result<[f32; 3], String> {
    let values: Result<Vec<f32>, _> = text.split(',').map(|v| v.trim().parse::<f32>()).collect();
    match values.as_deref() {
        Ok([elevation, azimuth, lux]) => Ok([*elevation, *azimuth, *lux]),
        _ => Err("expected degrees, degrees and lux separated by commas, as in 40,180,80000".to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_numbers_or_colours() {
        let weight = |group: &str, by: [f32; 3]| Ok(Weight { group: group.into(), by: by.into() });
        assert_eq!(parse_weight("lamps=0.2"), weight("lamps", [0.2; 3]));
        assert_eq!(parse_weight("sun=1, 0.9,0.8"), weight("sun", [1.0, 0.9, 0.8]));
        for wrong in ["lamps", "lamps=", "lamps=1,2", "lamps=-1", "lamps=nan"] {
            assert!(parse_weight(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sky_takes_one_or_three_numbers() {
        assert_eq!(parse_sky("1, 2,3"), Ok(SkySetting::Constant([1.0, 2.0, 3.0])));
        assert_eq!(parse_sky("0.5"), Ok(SkySetting::Constant([0.5; 3])));
        assert_eq!(parse_sky("clear"), Ok(SkySetting::Clear { turbidity: 3.0 }));
        assert_eq!(parse_sky("clear, 2.5"), Ok(SkySetting::Clear { turbidity: 2.5 }));
        assert!(parse_sky("1,2").is_err() && parse_sky("blue").is_err() && parse_sky("clear,x").is_err());
        assert_eq!(parse_sun("40,-10,8e4"), Ok([40.0, -10.0, 8e4]));
        assert!(parse_sun("40,180").is_err());
    }
}
