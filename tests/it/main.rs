//! The one integration binary: it keeps link time down.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise")]

mod damage;
mod foreign;
mod import;
mod info;
mod recover;
mod support;
mod tables;
