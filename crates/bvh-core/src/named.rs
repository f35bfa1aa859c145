//! Names of enum variants, for command lines and result files.

/// A name that stands for nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown {what} '{found}'; expected one of {expected}")]
pub struct UnknownName {
    what: &'static str,
    found: String,
    expected: String,
}

/// Finds the one of `all` that has the name `found`.
///
/// # Errors
/// If none has.
pub fn by_name<T: Copy>(
    what: &'static str,
    all: &[T],
    name: fn(T) -> &'static str,
    found: &str,
) -> Result<T, UnknownName> {
    all.iter().copied().find(|&t| name(t) == found).ok_or_else(|| {
        let expected = all.iter().map(|&t| name(t)).collect::<Vec<_>>().join(", ");
        UnknownName { what, found: found.to_owned(), expected }
    })
}

/// Gives each variant of an enum a name: adds `ALL`, `name`, `Display` and `FromStr`. `$what` says
/// in errors what the names are of.
#[doc(hidden)]
#[macro_export]
macro_rules! named {
    ($type:ident, $what:literal, $($variant:ident = $name:literal),+ $(,)?) => {
        impl $type {
            /// All values.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$variant),+];

            /// Returns the name used on command lines and in result files.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }

        impl ::std::fmt::Display for $type {
            /// Writes the [name](Self::name).
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                f.pad(self.name())
            }
        }

        impl ::std::str::FromStr for $type {
            type Err = $crate::UnknownName;

            /// Finds the value of that [name](Self::name).
            fn from_str(name: &str) -> Result<Self, $crate::UnknownName> {
                $crate::named::by_name($what, &Self::ALL, Self::name, name)
            }
        }
    };
}
