//! JSON schemas of types whose form in a profile differs from their form in Rust.

/// Implements `JsonSchema` for a type: the name of its schema, and the schema as JSON.
macro_rules! schema_of {
    ($type:ty as $name:literal: $schema:tt) => {
        impl schemars::JsonSchema for $type {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                $name.into()
            }

            fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
                schemars::json_schema!($schema)
            }
        }
    };
}
pub(crate) use schema_of;
