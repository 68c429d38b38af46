#![expect(clippy::unwrap_used, reason="t")] fn main(){}
