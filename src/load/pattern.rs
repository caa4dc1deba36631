//! Patterns over paths, by which settings name objects, materials and lamps.
//!
//! A path is names joined by `/`. In a pattern `*` stands for anything within a name, `?` for one character, and the name
//! `**` for any number of names. A pattern with a leading `/` begins at the root, others anywhere. What lies below a match is
//! matched too, as it inherits what is said of its parent. The number of an instance, as in `Tree[3]`, may be left out.

use std::collections::BTreeSet;

/// Names that are held against a pattern that matches nothing.
const MOST_NAMES: usize = 20_000;
/// Names that are told.
const TOLD: usize = 3;

/// A pattern, taken apart at each `**`.
#[derive(Clone, Debug)]
pub struct Pattern {
    /// Runs of names; the first one begins at the root, each other one anywhere below the one before.
    runs: Vec<Vec<String>>,
    /// Ends in `**`: what is matched lies below the last run.
    is_below: bool,
}

impl Pattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// A message where it is empty.
    pub fn new(text: &str) -> Result<Self, String> {
        let mut names: Vec<&str> = text.split('/').filter(|n| !n.is_empty()).collect();
        if names.is_empty() {
            return Err("is an empty pattern; give a path such as Room/Chair*, or ** for everything".into());
        }
        let is_below = names.last() == Some(&"**");
        if !text.starts_with('/') {
            names.insert(0, "**");
        }
        let mut runs = vec![Vec::new()];
        for name in names {
            match name {
                "**" => runs.push(Vec::new()),
                name => runs.last_mut().expect("one at least").push(name.to_owned()),
            }
        }
        if is_below {
            runs.pop();
        }
        Ok(Self { runs, is_below })
    }

    /// True where `path`, or something above it, is matched.
    pub fn holds(&self, path: &str) -> bool {
        let names: Vec<&str> = path.split('/').filter(|n| !n.is_empty()).collect();
        let mut at = 0;
        // The leftmost place of each run leaves most for the next.
        for (k, run) in self.runs.iter().enumerate() {
            let starts = if k == 0 { 0..=0 } else { at..=names.len() };
            let fits = |start: &usize| {
                let there = names.get(*start..*start + run.len());
                there.is_some_and(|there| run.iter().zip(there).all(|(p, n)| is_named(p, n)))
            };
            match starts.into_iter().find(fits) {
                Some(start) => at = start + run.len(),
                None => return false,
            }
        }
        !self.is_below || at < names.len()
    }
}

/// True where `name` matches, with or without the number of its instance.
fn is_named(pattern: &str, name: &str) -> bool {
    glob(pattern, name)
        || name.strip_suffix(']').and_then(|n| n.rsplit_once('[')).is_some_and(|(n, _)| glob(pattern, n))
}

/// True where `name` is as `pattern` says: `*` stands for anything, `?` for one character.
pub fn glob(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    // The last star, and the place in the name up to which it reaches so far.
    let (mut p, mut n, mut star) = (0, 0, None);
    while n < name.len() {
        if pattern.get(p) == Some(&'*') {
            star = Some((p, n));
            p += 1;
        } else if pattern.get(p).is_some_and(|c| *c == '?' || *c == name[n]) {
            (p, n) = (p + 1, n + 1);
        } else if let Some((at, reached)) = star {
            star = Some((at, reached + 1));
            (p, n) = (at + 1, reached + 1);
        } else {
            return false;
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

/// What to say of a pattern that matches nothing: the names most like it, else the first ones.
pub fn near<'a>(pattern: &str, paths: impl Iterator<Item = &'a str>) -> String {
    let mut names: BTreeSet<&str> = BTreeSet::new();
    for path in paths {
        if names.len() > MOST_NAMES {
            break;
        }
        names.insert(path);
        names.extend(path.rsplit('/').next().filter(|n| !n.is_empty()));
    }
    let wanted = pattern.rsplit('/').find(|n| !n.is_empty() && *n != "**").unwrap_or(pattern);
    let wanted: Vec<char> = wanted.chars().filter(|c| !"*?".contains(*c)).flat_map(char::to_lowercase).collect();
    let mut ranked: Vec<(usize, &str)> = names.iter().map(|n| (distance(&wanted, n), *n)).collect();
    ranked.sort();
    let limit = (wanted.len() / 3).max(2);
    let close: Vec<&str> = ranked.iter().take_while(|(d, _)| *d <= limit).take(TOLD).map(|(_, n)| *n).collect();
    if !close.is_empty() {
        return format!("near to it: {}", close.join(", "));
    }
    let first: Vec<&str> = names.iter().take(TOLD).copied().collect();
    if first.is_empty() { "there are none".into() } else { format!("there are {}, ...", first.join(", ")) }
}

/// Letters that have to be changed, put in or left out (Levenshtein 1966), in whatever case.
fn distance(a: &[char], b: &str) -> usize {
    let mut row: Vec<usize> = (0..=a.len()).collect();
    for (i, c) in b.chars().flat_map(char::to_lowercase).take(256).enumerate() {
        let mut corner = row[0];
        row[0] = i + 1;
        for (k, d) in a.iter().enumerate() {
            let changed = corner + usize::from(*d != c);
            corner = row[k + 1];
            row[k + 1] = changed.min(row[k] + 1).min(corner + 1);
        }
    }
    row[a.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn globs() {
        for (pattern, name) in
            [("*", ""), ("a*c", "abbc"), ("a?c", "abc"), ("*/Spot*", "/Lights/Spot_1"), ("**b", "aab")]
        {
            assert!(glob(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("", "a"), ("a?", "a"), ("*b", "ba"), ("a*b*c", "acb"), ("Spot", "/Spot")] {
            assert!(!glob(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn patterns_hold_for_what_lies_below() {
        let holds = |pattern: &str, path: &str| Pattern::new(pattern).unwrap().holds(path);
        for (pattern, path) in [
            ("**", "A"),
            ("B", "A/B/C"),
            ("/A", "/A/B"),
            ("A/B", "/A/B"),
            ("B/C", "/A/B/C"),
            ("B/*", "A/B/C"),
            ("B/**", "A/B/C"),
            ("/A/*/C", "/A/B/C/D"),
            ("/A/**/D", "/A/B/C/D"),
            ("/A/**/D", "/A/D"),
            ("/A/**", "/A/B"),
            ("Tree", "Wood/Tree[3]"),
            ("Tree[3]", "Wood/Tree[3]"),
            ("**/b/**/d", "a/b/b/c/d/e"),
        ] {
            assert!(holds(pattern, path), "{pattern} {path}");
        }
        for (pattern, path) in [
            ("/B", "/A/B"),
            ("/A/*", "/A"),
            ("/A/**", "/A"),
            ("B/**", "A/B"),
            ("A/C", "/A/B/C"),
            ("Tree[2]", "Wood/Tree[3]"),
            ("Tree", "Wood/Trees"),
            ("**/d/**/b", "a/b/c/d"),
        ] {
            assert!(!holds(pattern, path), "{pattern} {path}");
        }
        assert!(Pattern::new("/").is_err() && Pattern::new("").is_err());
    }

    #[test]
    fn a_slip_is_told_by_what_is_near() {
        let paths = ["Room/Chair", "Room/Table", "Room/Lamp"];
        assert_eq!(near("Chiar", paths.into_iter()), "near to it: Chair");
        assert!(near("Elephant", paths.into_iter()).starts_with("there are Chair, Lamp"));
        assert_eq!(near("x", std::iter::empty()), "there are none");
    }
}
