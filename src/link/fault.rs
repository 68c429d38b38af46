//! Conversion of SocketCAN error frames to [`BusFault`]s.
//!
//! Source: Linux `include/uapi/linux/can/error.h`: the id holds the classes of an error, the data
//! bytes their details (byte 1 the controller). One error frame may report several faults; the most
//! severe comes first. Classes without a fault here are ignored (transceiver states, counters).

use super::BusFault;

/// Transmission timeout of the driver.
const TX_TIMEOUT: u32 = 0x001;
const LOST_ARBITRATION: u32 = 0x002;
/// Controller problem; details in byte 1.
const CONTROLLER: u32 = 0x004;
const PROTOCOL: u32 = 0x008;
const NO_ACKNOWLEDGE: u32 = 0x020;
const BUS_OFF: u32 = 0x040;
const BUS_ERROR: u32 = 0x080;
const RESTARTED: u32 = 0x100;

const CONTROLLER_BYTE: usize = 1;
const OVERFLOW: u8 = 0x01 | 0x02;
const WARNING: u8 = 0x04 | 0x08;
const PASSIVE: u8 = 0x10 | 0x20;
const ACTIVE: u8 = 0x40;

/// Return the faults of an error frame. `classes` is its id without flag bits, `data` its data
/// bytes, which may be missing (a gateway forwards only the classes).
#[must_use]
pub(super) fn faults_of_error_frame(classes: u32, data: &[u8]) -> Vec<BusFault> {
    let mut faults = Vec::new();
    let mut add = |present: bool, fault: BusFault| {
        if present {
            faults.push(fault);
        }
    };
    let class = |mask: u32| classes & mask != 0;
    add(class(BUS_OFF), BusFault::BusOff);
    add(class(RESTARTED), BusFault::Restarted);
    if class(CONTROLLER) {
        let state = data.get(CONTROLLER_BYTE).copied().unwrap_or(0);
        let says = |mask: u8| state & mask != 0;
        add(says(OVERFLOW), BusFault::Overrun { frames: 0 });
        add(says(PASSIVE), BusFault::ErrorPassive);
        // Without the controller's state from a gateway, report a warning at least.
        add(says(WARNING) || state == 0, BusFault::ErrorWarning);
        add(says(ACTIVE), BusFault::ErrorActive);
    }
    add(class(NO_ACKNOWLEDGE), BusFault::NoAcknowledge);
    // An error frame with a missing acknowledgement only is no protocol error.
    let protocol = class(TX_TIMEOUT | LOST_ARBITRATION)
        || class(PROTOCOL | BUS_ERROR) && !class(NO_ACKNOWLEDGE) && !class(CONTROLLER);
    add(protocol, BusFault::Protocol);
    faults
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Error frames that the kernel's slcan driver creates from an adapter's status lines.
    #[test]
    fn error_frames_of_the_kernel() {
        let state = |byte: u8| [0, byte, 0, 0, 0, 0, 0, 96];
        for (classes, data, expected) in [
            (0x204, state(0x0C), vec![BusFault::ErrorWarning]),
            (0x204, state(0x04), vec![BusFault::ErrorWarning]),
            (0x204, state(0x20), vec![BusFault::ErrorPassive]),
            (0x204, state(0x40), vec![BusFault::ErrorActive]),
            (0x040, state(0), vec![BusFault::BusOff]),
            (0x100, state(0), vec![BusFault::Restarted]),
            (0x0A8, state(0), vec![BusFault::NoAcknowledge]),
            (0x088, state(0), vec![BusFault::Protocol]),
            (0x08C, state(0x01), vec![BusFault::Overrun { frames: 0 }]),
            (0x08C, state(0x02), vec![BusFault::Overrun { frames: 0 }]),
            (0x002, state(0), vec![BusFault::Protocol]),
            (0x044, state(0x30), vec![BusFault::BusOff, BusFault::ErrorPassive]),
            (0x200, state(0), vec![]),
        ] {
            assert_eq!(faults_of_error_frame(classes, &data), expected, "{classes:#X} {data:?}");
        }
        assert_eq!(faults_of_error_frame(0x004, &[]), [BusFault::ErrorWarning]);
        assert_eq!(faults_of_error_frame(0x080, &[]), [BusFault::Protocol]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Bus-off is always reported, and first.
        #[test]
        fn bus_off_is_never_hidden(classes in 0_u32..0x400, data in proptest::collection::vec(any::<u8>(), 0..=8)) {
            let faults = faults_of_error_frame(classes | BUS_OFF, &data);
            prop_assert_eq!(faults.first(), Some(&BusFault::BusOff));
        }
    }
}
