//! Macro that declares a part of the configuration: its fields, defaults and ranges.

use super::ConfigError;

/// Check that `value` is in `[low, high]`; NaN is always an error.
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

/// Declare a struct of numbers, each `name: default in [low, high]`, and of `other` fields.
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
            /// Check the numbers against their ranges; `path` precedes each name.
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
