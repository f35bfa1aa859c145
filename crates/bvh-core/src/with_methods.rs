//! A method for each option, for structures that may get more fields.

/// Adds a method for each field that gives the value with another content of that field.
#[doc(hidden)]
#[macro_export]
macro_rules! with_methods {
    ($type:ident: $($with:ident($field:ident: $content:ty)),+) => {
        impl $type {
            $(
                #[doc = concat!("Returns the same options with another [`", stringify!($field), "`](Self::", stringify!($field), ").")]
                #[must_use]
                pub const fn $with(mut self, $field: $content) -> Self {
                    self.$field = $field;
                    self
                }
            )+
        }
    };
}
