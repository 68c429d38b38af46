//! Declares a part of the configuration once: its fields, their defaults and their ranges.

use super::ConfigError;

/// Refuses a number outside `low` to `high`, both included; NaN is always refused.
pub(in crate::rig) fn within(
    name: &str,
    value: f64,
    low: f64,
    high: f64,
) -> Result<(), ConfigError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(ConfigError::OutOfRange { name: name.to_owned(), value, low, high })
    }
}

/// Declares a struct of numbers, each `name: default in [least, most]`, and of `other` fields.
macro_rules! ranged {
    (
        $(#[$meta:meta])*
        $name:ident {
            $($(#[$doc:meta])* $field:ident: $default:literal in [$low:literal, $high:literal];)*
        }
        $(other {
            $($(#[$other_doc:meta])* $other:ident: $kind:ty = $other_default:expr;)*
        })?
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $($(#[$doc])* pub $field: f64,)*
            $($($(#[$other_doc])* pub $other: $kind,)*)?
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* $($($other: $other_default,)*)? }
            }
        }

        impl $name {
            /// Checks the numbers against their ranges; `path` stands before each name.
            pub(in crate::rig) fn check_numbers(
                &self,
                path: &str,
            ) -> Result<(), $crate::rig::config::ConfigError> {
                $($crate::rig::config::ranged::within(
                    &format!("{path}{}", stringify!($field)),
                    self.$field,
                    $low,
                    $high,
                )?;)*
                Ok(())
            }
        }
    };
}

pub(in crate::rig) use ranged;
