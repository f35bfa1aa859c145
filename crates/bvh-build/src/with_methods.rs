//! A macro for options.

/// Adds a method for each field that gives the value with another content of that field.
macro_rules! with_methods {
    ($type:ident: $($with:ident($field:ident: $content:ty)),+) => {
        impl $type {
            $(
                #[doc = concat!("The same with another [`", stringify!($field), "`](Self::", stringify!($field), ").")]
                #[must_use]
                pub const fn $with(mut self, $field: $content) -> Self {
                    self.$field = $field;
                    self
                }
            )+
        }
    };
}
pub(crate) use with_methods;
