//! Flushing of denormal numbers to zero, for one thread and one computation.
//!
//! A value below 1.2e-38 costs a processor some hundred cycles. Decaying moments and saturated
//! units produce such values, and no result depends on them. The flags are those of the manuals:
//! x86 `MXCSR`, flush to zero (bit 15) and denormals are zero (bit 6) (Intel SDM volume 1, section
//! 10.2.3); AArch64 `FPCR`, flush to zero (bit 24). On other processors the computation runs
//! unchanged: slower with denormals, and with different last digits.

/// Run `work` with denormal numbers flushed to zero in this thread, then restore the mode, also
/// when `work` panics. Threads started by `work` are not affected.
pub fn flushing_denormals<R>(work: impl FnOnce() -> R) -> R {
    let _restored_at_the_end = Flushing::begin();
    work()
}

/// Previous value of the control register.
struct Flushing(control::Register);

impl Flushing {
    fn begin() -> Self {
        let before = control::read();
        control::write(before | control::FLUSH);
        Self(before)
    }
}

impl Drop for Flushing {
    fn drop(&mut self) {
        control::write(self.0);
    }
}

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "the control register has no safe access")]
mod control {
    use std::arch::asm;

    pub(super) type Register = u32;

    /// Flush to zero, denormals are zero.
    pub(super) const FLUSH: Register = 1 << 15 | 1 << 6;

    pub(super) fn read() -> Register {
        let mut value: Register = 0;
        // SAFETY: stores the register to a valid, aligned place and touches nothing else.
        unsafe { asm!("stmxcsr [{}]", in(reg) &raw mut value, options(nostack, preserves_flags)) };
        value
    }

    pub(super) fn write(value: Register) {
        // SAFETY: the value was read from the register, with two defined bits set or not; rounding
        // and exception masks stay as they were, so no operation traps or rounds otherwise.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &raw const value, options(nostack, readonly)) };
    }
}

#[cfg(target_arch = "aarch64")]
#[expect(unsafe_code, reason = "the control register has no safe access")]
mod control {
    use std::arch::asm;

    pub(super) type Register = u64;

    /// Flush to zero.
    pub(super) const FLUSH: Register = 1 << 24;

    pub(super) fn read() -> Register {
        let value: Register;
        // SAFETY: reads a register that every thread may read.
        unsafe { asm!("mrs {}, fpcr", out(reg) value, options(nomem, nostack, preserves_flags)) };
        value
    }

    pub(super) fn write(value: Register) {
        // SAFETY: the value was read from the register, with one defined bit set or not.
        unsafe { asm!("msr fpcr, {}", in(reg) value, options(nomem, nostack)) };
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod control {
    pub(super) type Register = u32;

    pub(super) const FLUSH: Register = 0;

    pub(super) fn read() -> Register {
        0
    }

    pub(super) fn write(_value: Register) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::hint::black_box;

    fn halved_smallest() -> f32 {
        black_box(f32::MIN_POSITIVE) * black_box(0.5)
    }

    #[test]
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    fn denormals_are_flushed_inside_and_kept_outside() {
        assert!(0.0 < halved_smallest());
        assert!(flushing_denormals(halved_smallest).to_bits() == 0);
        assert!(0.0 < halved_smallest());
    }

    #[test]
    fn a_panic_sets_things_back() {
        let caught = std::panic::catch_unwind(|| flushing_denormals(|| panic!("on purpose")));
        assert!(caught.is_err());
        assert!(0.0 < halved_smallest());
    }
}
