//! How strategies share a path: the power heuristic over all of them (Veach 1997, sections 9.2 and 10.2).
//!
//! A path has the places x_0 on the light to x_{k-1} on the sensor. Strategy s draws the first s of them from the light's side and the
//! rest from the eye's, and there are k + 1 of them. What differs between two neighbouring strategies is the side that one place
//! is drawn from, so one pass along the path tells the densities of all.

/// A place of a path beyond the light, and with what density [1/m^2] either side draws it.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub from_light: f32,
    pub from_eye: f32,
    /// It may be joined to a neighbour: no mirror or clear glass sent the light on here.
    pub joins: bool,
}

/// The light's end of a path as the strategies draw it, all densities of directions at the second place [1/sr], or chances where there is
/// but one.
#[derive(Clone, Copy, Debug)]
pub struct LightEnd {
    /// Met by the eye's walk.
    pub met: f32,
    /// Drawn for the second place.
    pub drawn: f32,
    /// Set out from.
    pub emitted: f32,
}

impl LightEnd {
    fn density(&self, strategy: usize) -> f64 {
        f64::from(match strategy {
            0 => self.met,
            1 => self.drawn,
            _ => self.emitted,
        })
    }
}

/// The weight of `strategy` for the path from `end` over `places`; over all strategies that can find the path weights add up to 1.
pub fn weight(end: &LightEnd, places: &[Place], strategy: usize) -> f32 {
    let own = end.density(strategy);
    if own <= 0.0 {
        return 0.0;
    }
    // Of strategy i, place i - 1 is joined to place i: none where either walk finds the whole path.
    let joins = |i: usize| i == 0 || i > places.len() || (i == 1 || places[i - 2].joins) && places[i - 1].joins;
    let mut sum = 1.0;
    let mut ratio = 1.0;
    let mut add = |i: usize, ratio: f64| {
        if joins(i) {
            sum += (ratio * end.density(i) / own).powi(2);
        }
    };
    for i in (0..strategy).rev() {
        if i > 0 {
            ratio *= f64::from(places[i - 1].from_eye) / f64::from(places[i - 1].from_light);
        }
        add(i, ratio);
    }
    ratio = 1.0;
    for i in strategy + 1..=places.len() + 1 {
        if i > 1 {
            ratio *= f64::from(places[i - 2].from_light) / f64::from(places[i - 2].from_eye);
        }
        add(i, ratio);
    }
    let weight = (1.0 / sum) as f32;
    if weight.is_finite() { weight } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(from_light: f32, from_eye: f32, joins: bool) -> Place {
        Place { from_light, from_eye, joins }
    }

    #[test]
    fn weights_add_up_over_the_strategies_that_can_find_a_path() {
        let end = LightEnd { met: 0.3, drawn: 2.0, emitted: 0.7 };
        let places = [
            place(0.2, 5.0, true),
            place(1.5, 0.1, false),
            place(3.0, 0.4, true),
            place(0.9, 2.0, true),
            place(1.1, 0.6, true),
        ];
        // Place 2 is a mirror: nothing joins it.
        let can = [0, 1, 4, 5, 6];
        let each = can.map(|s| weight(&end, &places, s));
        assert!((each.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{each:?}");
        // In proportion to the squares of the densities, here of the first two.
        let [a, b] = [0, 1].map(|s| weight(&end, &places, s));
        assert!((b / a - (2.0f32 / 0.3).powi(2)).abs() < 1e-3);
        // Of the last two: the sensor's own place.
        let [a, b] = [5, 6].map(|s| weight(&end, &places, s));
        assert!((b / a - (1.1f32 / 0.6).powi(2)).abs() < 1e-3);
    }

    #[test]
    fn what_a_strategy_never_draws_weighs_nothing() {
        let point = LightEnd { met: 0.0, drawn: 0.5, emitted: 0.5 };
        let places = [place(1.0, 1.0, true), place(0.0, 1.0, true)];
        assert_eq!(weight(&point, &places, 0), 0.0);
        // Met never, and the last place is no light's to find: two strategies are left.
        let each = [1, 2].map(|s| weight(&point, &places, s));
        assert_eq!(each, [0.5, 0.5]);
    }
}
