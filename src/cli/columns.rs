//! Table of the log columns that a verb uses, and of the other log columns with the reason why the verb does not use
//! them.

use std::io::{self, Write};

use isotherm_identify::dataset::{Column, Dataset, UnusedColumn};

/// Log columns that a verb uses, and other log columns with the reason why the verb does not use them.
#[derive(Debug, serde::Serialize)]
pub(super) struct ColumnTable {
    used: Vec<String>,
    not_used: Vec<UnusedColumn>,
}

impl ColumnTable {
    /// Creates the table. `is_used` returns whether the verb uses a column.
    pub(super) fn new(dataset: &Dataset, is_used: &dyn Fn(&Column) -> bool) -> ColumnTable {
        let used = dataset.columns.iter().filter(|column| is_used(column)).map(|column| column.name.clone());
        ColumnTable { used: used.collect(), not_used: dataset.unused(is_used) }
    }

    /// Prints the table if at least one column is not used.
    pub(super) fn render(&self, out: &mut impl Write) -> io::Result<()> {
        if self.not_used.is_empty() {
            return Ok(());
        }
        writeln!(out, "\ncolumns used: {}\ncolumns not used:", self.used.join(", "))?;
        let width = self.not_used.iter().map(|column| column.name.chars().count()).max().unwrap_or(0);
        for column in &self.not_used {
            writeln!(out, "  {:width$}  {}", column.name, column.why)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_names_each_column_and_is_empty_if_all_are_used() {
        let mut table = ColumnTable { used: vec!["bed".to_owned()], not_used: Vec::new() };
        let text = |table: &ColumnTable| {
            let mut text = Vec::new();
            table.render(&mut text).unwrap();
            String::from_utf8(text).unwrap()
        };
        assert_eq!(text(&table), "");
        let why = "day.csv, line 2: `A` is not a number".to_owned();
        table.not_used.push(UnusedColumn { name: "part".to_owned(), why });
        let expected =
            "\ncolumns used: bed\ncolumns not used:\n  part  day.csv, line 2: `A` is not a number\n";
        assert_eq!(text(&table), expected);
    }
}
