//! Settings whose values have names.

/// Gives an enum its list of all values, and each value its name, which reads back. Other names give this
/// error.
macro_rules! named {
    ($setting:ident { $($value:ident = $name:literal),+ } else $error:expr) => {
        impl $setting {
            /// Every value.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$value),+];

            /// The name used on the command line and in reports.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name),+
                }
            }
        }

        impl std::fmt::Display for $setting {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $setting {
            type Err = crate::SettingsError;

            fn from_str(name: &str) -> Result<Self, Self::Err> {
                let named = Self::ALL.into_iter().find(|value| value.name() == name);
                named.ok_or_else(|| $error(name.to_owned()))
            }
        }
    };
}

pub(crate) use named;
