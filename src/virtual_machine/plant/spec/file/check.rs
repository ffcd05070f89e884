//! Lookup of the names in a plant file, and collection of its errors.

use crate::virtual_machine::plant::structure::Point;

/// Name of the air in links, sensors and displacements.
pub(super) const AMBIENT: &str = "ambient";

/// Names of all points that have a temperature, and the errors found so far.
pub(super) struct Check {
    pub(super) names: Vec<(String, Point)>,
    pub(super) errors: Vec<String>,
}

impl Check {
    pub(super) fn demand(&mut self, holds: bool, complaint: impl FnOnce() -> String) {
        if !holds {
            self.errors.push(complaint());
        }
    }

    /// Returns the point with this name. For an unknown name, adds an error and returns the air.
    pub(super) fn point(&mut self, place: &str, name: &str) -> Point {
        if name == AMBIENT {
            return Point::Ambient;
        }
        if let Some((_, point)) = self.names.iter().find(|(known, _)| known == name) {
            return *point;
        }
        let known: Vec<&str> = self.names.iter().map(|(name, _)| name.as_str()).collect();
        let known = known.join(", ");
        self.errors.push(format!("{place}: there is no node `{name}`; allowed: {known}, {AMBIENT}"));
        Point::Ambient
    }

    /// Returns the index of the node with this name. For any other name, adds an error.
    pub(super) fn node(&mut self, place: &str, name: &str) -> usize {
        let before = self.errors.len();
        match self.point(place, name) {
            Point::Node(index) => index,
            _ => {
                self.demand(self.errors.len() > before, || {
                    format!("{place}: `{name}` has no heat capacity; write the name of a node")
                });
                0
            }
        }
    }

    /// Returns the node with this name, or the air, as the medium around a structure. For any other name, adds an
    /// error.
    pub(super) fn surroundings(&mut self, place: &str, name: &str) -> Point {
        match self.point(place, name) {
            point @ (Point::Node(_) | Point::Ambient) => point,
            _ => {
                self.demand(false, || {
                    format!(
                        "{place}: `{name}` is a part of the structure; write the name of a node, or {AMBIENT}"
                    )
                });
                Point::Ambient
            }
        }
    }
}
