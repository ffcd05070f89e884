//! Columns of the exported files of a machine. Every file has the columns of all days, because some programs read the
//! list of columns from only one of the files.

use std::collections::BTreeMap;

use super::table::Kind;

/// First columns of every exported file. The columns of the logs follow.
pub(super) const FIRST: [(&str, Kind); 2] = [("time", Kind::Moment), ("machine", Kind::Text)];

/// Name and type of a column.
pub(super) type Column = (String, Kind);

/// Columns of the exported files of all days, in the order in which they were added. Each name occurs once.
#[derive(Debug)]
pub(super) struct Columns {
    all: Vec<Column>,
    places: BTreeMap<String, usize>,
}

impl Columns {
    /// Creates the list with the first columns of every exported file ([`FIRST`]).
    pub(super) fn new() -> Columns {
        let mut columns = Columns { all: Vec::new(), places: BTreeMap::new() };
        FIRST.into_iter().for_each(|(name, kind)| columns.push(name.to_owned(), kind));
        columns
    }

    pub(super) fn all(&self) -> &[Column] {
        &self.all
    }

    /// Adds a column of an earlier exported file, under the name that it has in that file. A name that is already in
    /// the list is ignored.
    pub(super) fn add_exported(&mut self, name: &str, kind: Kind) {
        if !self.places.contains_key(name) {
            self.push(name.to_owned(), kind);
        }
    }

    /// Adds a column of a log. If its name is already taken by another column, a suffix is added.
    pub(super) fn add(&mut self, name: &str, kind: Kind) {
        if let Err(free) = self.find(name, kind) {
            self.push(free, kind);
        }
    }

    /// Returns the index of a log column in the exported table; `None` if the column was not added.
    pub(super) fn place(&self, name: &str, kind: Kind) -> Option<usize> {
        self.find(name, kind).ok()
    }

    /// Returns the index of a log column in the exported table. If the column was not added yet, the error is a free
    /// name for the column. The free name has a suffix if one of the first columns has the name `name`, or if a column
    /// of another type has it.
    fn find(&self, name: &str, kind: Kind) -> Result<usize, String> {
        let ending = if kind == Kind::Number { "signal" } else { "axis" };
        let mut name = name.to_owned();
        while let Some(place) = self.places.get(&name) {
            if *place >= FIRST.len() && self.all.get(*place).is_some_and(|(_, known)| *known == kind) {
                return Ok(*place);
            }
            name = format!("{name}_{ending}");
        }
        Err(name)
    }

    fn push(&mut self, name: String, kind: Kind) {
        self.places.insert(name.clone(), self.all.len());
        self.all.push((name, kind));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(columns: &Columns) -> Vec<&str> {
        columns.all().iter().map(|(name, _)| name.as_str()).collect()
    }

    #[test]
    fn a_column_is_added_once_in_the_order_of_the_days() {
        let mut columns = Columns::new();
        for (name, kind) in [("bed", Kind::Number), ("z_state", Kind::Text), ("head", Kind::Number)] {
            columns.add(name, kind);
            columns.add(name, kind);
        }
        columns.add_exported("bed", Kind::Number);
        columns.add_exported("old", Kind::Number);
        assert_eq!(names(&columns), ["time", "machine", "bed", "z_state", "head", "old"]);
        assert_eq!(columns.place("z_state", Kind::Text), Some(3));
        assert_eq!(columns.place("old", Kind::Number), Some(5));
        assert_eq!(columns.place("new", Kind::Number), None);
    }

    #[test]
    fn a_signal_with_the_name_of_another_column_gets_an_ending() {
        let mut columns = Columns::new();
        columns.add("machine", Kind::Number);
        columns.add("x_state", Kind::Number);
        // The profile has got an axis x since.
        columns.add("x_state", Kind::Text);
        assert_eq!(names(&columns), ["time", "machine", "machine_signal", "x_state", "x_state_axis"]);
        assert_eq!(columns.place("machine", Kind::Number), Some(2));
        assert_eq!(columns.place("x_state", Kind::Number), Some(3));
        assert_eq!(columns.place("x_state", Kind::Text), Some(4));
        // After an export, the names are the same again.
        let mut again = Columns::new();
        columns.all().iter().skip(FIRST.len()).for_each(|(name, kind)| again.add_exported(name, *kind));
        for (name, kind) in [("x_state", Kind::Text), ("machine", Kind::Number), ("x_state", Kind::Number)] {
            again.add(name, kind);
        }
        assert_eq!(again.all(), columns.all());
    }
}
