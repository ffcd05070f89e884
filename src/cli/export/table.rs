//! Table of times, numbers and texts as a Parquet file. It is written in parts, so that the memory does not grow with
//! the length of a day.

use std::fs::File;
use std::sync::Arc;

use isotherm_core::quantity::Moment;
use parquet::basic::{Compression, LogicalType, Repetition, TimeUnit, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::properties::{WriterProperties, WriterPropertiesBuilder};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

/// Maximum number of values that are collected in memory before a part of the table is written.
pub(super) const HELD: usize = 2_000_000;

/// Type of a column of the exported table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Time in UTC, to the microsecond. Every row must have it.
    Moment,
    Number,
    Text,
}

/// Values of a column of the exported table. For numbers and texts, a flag for each row is 1 if the row has a value,
/// else 0.
#[derive(Debug)]
enum Cells {
    Moments(Vec<i64>),
    Numbers(Vec<f64>, Vec<i16>),
    Texts(Vec<ByteArray>, Vec<i16>),
}

/// Table that is being written to a Parquet file.
pub(super) struct Table<'f> {
    writer: SerializedFileWriter<&'f mut File>,
    columns: Vec<Cells>,
    rows: usize,
}

impl<'f> Table<'f> {
    /// Begins a table with these columns in a file.
    pub(super) fn new(file: &'f mut File, columns: &[(String, Kind)]) -> Result<Table<'f>, ParquetError> {
        let fields = columns.iter().map(|(name, kind)| field(name, *kind).map(Arc::new));
        let fields = fields.collect::<Result<Vec<_>, _>>()?;
        let schema = Arc::new(Type::group_type_builder("log").with_fields(fields).build()?);
        let writer = SerializedFileWriter::new(file, schema, Arc::new(properties().build()))?;
        let columns = columns.iter().map(|(_, kind)| Cells::of(*kind)).collect();
        Ok(Table { writer, columns, rows: 0 })
    }

    pub(super) fn moment(&mut self, column: usize, moment: Moment) {
        if let Some(Cells::Moments(moments)) = self.columns.get_mut(column) {
            moments.push(i64::try_from(moment.as_nanos() / 1000).unwrap_or(i64::MAX));
        }
    }

    pub(super) fn number(&mut self, column: usize, number: Option<f64>) {
        if let Some(Cells::Numbers(numbers, there)) = self.columns.get_mut(column) {
            there.push(i16::from(number.is_some()));
            numbers.extend(number);
        }
    }

    pub(super) fn text(&mut self, column: usize, text: Option<&str>) {
        if let Some(Cells::Texts(texts, there)) = self.columns.get_mut(column) {
            there.push(i16::from(text.is_some()));
            texts.extend(text.map(ByteArray::from));
        }
    }

    /// Ends a row of the exported table. Every column must have got its value before.
    pub(super) fn end_row(&mut self) -> Result<(), ParquetError> {
        self.rows += 1;
        if self.rows * self.columns.len() >= HELD { self.flush() } else { Ok(()) }
    }

    pub(super) fn finish(mut self) -> Result<(), ParquetError> {
        self.flush()?;
        self.writer.close().map(drop)
    }

    fn flush(&mut self) -> Result<(), ParquetError> {
        if self.rows == 0 {
            return Ok(());
        }
        self.rows = 0;
        let mut group = self.writer.next_row_group()?;
        for cells in &mut self.columns {
            let Some(mut column) = group.next_column()? else { break };
            match cells {
                Cells::Moments(moments) => {
                    column.typed::<Int64Type>().write_batch(moments, None, None)?;
                    moments.clear();
                }
                Cells::Numbers(numbers, there) => {
                    column.typed::<DoubleType>().write_batch(numbers, Some(there), None)?;
                    numbers.clear();
                    there.clear();
                }
                Cells::Texts(texts, there) => {
                    column.typed::<ByteArrayType>().write_batch(texts, Some(there), None)?;
                    texts.clear();
                    there.clear();
                }
            }
            column.close()?;
        }
        group.close().map(drop)
    }
}

impl Cells {
    fn of(kind: Kind) -> Cells {
        match kind {
            Kind::Moment => Cells::Moments(Vec::new()),
            Kind::Number => Cells::Numbers(Vec::new(), Vec::new()),
            Kind::Text => Cells::Texts(Vec::new(), Vec::new()),
        }
    }
}

/// Returns the Parquet properties of every exported file: compression, and isotherm as its creator.
pub(super) fn properties() -> WriterPropertiesBuilder {
    let packed = Compression::ZSTD(ZstdLevel::default());
    let by = concat!("isotherm ", env!("CARGO_PKG_VERSION")).to_owned();
    WriterProperties::builder().set_compression(packed).set_created_by(by)
}

/// Returns the Parquet schema of a column with this name and type.
pub(super) fn field(name: &str, kind: Kind) -> Result<Type, ParquetError> {
    let (physical, logical, repetition) = match kind {
        Kind::Moment => {
            let logical = LogicalType::timestamp(true, TimeUnit::MICROS);
            (Physical::INT64, Some(logical), Repetition::REQUIRED)
        }
        Kind::Number => (Physical::DOUBLE, None, Repetition::OPTIONAL),
        Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String), Repetition::OPTIONAL),
    };
    let field = Type::primitive_type_builder(name, physical).with_repetition(repetition);
    field.with_logical_type(logical).build()
}
