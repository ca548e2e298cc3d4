//! How a C3D file writes its numbers: by the processor that wrote it, and as integers or reals.

/// The processor whose byte order a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Processor {
    /// Intel: little-endian, IEEE 754.
    Intel,
    /// DEC: little-endian integers, VAX F reals.
    Dec,
    /// SGI and MIPS: big-endian, IEEE 754.
    Mips,
}

impl Processor {
    /// The processor of the fourth byte of the parameter section.
    pub(crate) fn of_byte(byte: u8) -> Option<Processor> {
        match byte {
            84 => Some(Processor::Intel),
            85 => Some(Processor::Dec),
            86 => Some(Processor::Mips),
            _ => None,
        }
    }

    /// A 16-bit integer.
    pub(crate) fn u16(self, bytes: [u8; 2]) -> u16 {
        match self {
            Processor::Mips => u16::from_be_bytes(bytes),
            _ => u16::from_le_bytes(bytes),
        }
    }

    /// The bytes of a 16-bit integer.
    pub(crate) fn u16_bytes(self, value: u16) -> [u8; 2] {
        match self {
            Processor::Mips => value.to_be_bytes(),
            _ => value.to_le_bytes(),
        }
    }

    /// A real of 32 bits.
    pub(crate) fn f32(self, bytes: [u8; 4]) -> f32 {
        match self {
            Processor::Intel => f32::from_le_bytes(bytes),
            Processor::Mips => f32::from_be_bytes(bytes),
            // A VAX real has its halves exchanged, and its exponent is two more than IEEE's.
            Processor::Dec => {
                let [a, b, c, d] = bytes;
                f32::from_le_bytes([c, d, a, b]) / 4.0
            }
        }
    }

    /// The bytes of a real; one too large for a VAX real becomes the largest that is not, one too
    /// small, and -0, which it does not have, 0.
    pub(crate) fn f32_bytes(self, value: f32) -> [u8; 4] {
        match self {
            Processor::Intel => value.to_le_bytes(),
            Processor::Mips => value.to_be_bytes(),
            Processor::Dec => {
                let most = f32::MAX / 4.0;
                let value = value.clamp(-most, most) * 4.0;
                let value = if value.is_normal() { value } else { 0.0 };
                let [c, d, a, b] = value.to_le_bytes();
                [a, b, c, d]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_back_in_every_byte_order() {
        for processor in [Processor::Intel, Processor::Dec, Processor::Mips] {
            for value in [0.0, 1.0, -1.0, 0.08333, -12345.678, 1e-20] {
                assert_eq!(processor.f32(processor.f32_bytes(value)), value);
            }
            assert_eq!(processor.u16(processor.u16_bytes(0x1234)), 0x1234);
        }
    }

    #[test]
    fn vax_reals_are_as_the_manual_has_them() {
        // 1.0 is 0x00004080 on a VAX: the bytes 80 40 00 00.
        assert_eq!(Processor::Dec.f32([0x80, 0x40, 0, 0]), 1.0);
        assert_eq!(Processor::Dec.f32([0x80, 0xc0, 0, 0]), -1.0);
        assert_eq!(Processor::Dec.f32([0, 0, 0, 0]), 0.0);
        assert_eq!(Processor::Dec.f32_bytes(-0.0), [0; 4]);
    }
}
