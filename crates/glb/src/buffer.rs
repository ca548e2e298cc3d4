//! The binary chunk, and the accessors that tell what stands where in it.

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::{Target, View};
use gltf_json::validation::{Checked::Valid, USize64};
use gltf_json::{Accessor, Index, Root, Value};

/// The arrays of a file.
#[derive(Debug, Default)]
pub(crate) struct Buffer {
    pub bytes: Vec<u8>,
}

impl Buffer {
    /// Adds rows of single precision. `bounds`: their smallest and largest components are told too.
    pub(crate) fn floats<const N: usize>(
        &mut self,
        root: &mut Root,
        rows: impl IntoIterator<Item = [f32; N]>,
        target: Option<Target>,
        bounds: bool,
    ) -> Index<Accessor> {
        let (mut low, mut high) = ([f32::INFINITY; N], [f32::NEG_INFINITY; N]);
        let (start, mut count) = (self.bytes.len(), 0);
        for row in rows {
            for (k, value) in row.into_iter().enumerate() {
                // The reader's minimum is that of the stored bits; -0 and 0 are equal to it.
                (low[k], high[k]) = (low[k].min(value), high[k].max(value));
                self.bytes.extend(value.to_le_bytes());
            }
            count += 1;
        }
        let kind = match N {
            1 => Type::Scalar,
            3 => Type::Vec3,
            4 => Type::Vec4,
            _ => Type::Mat4,
        };
        let index = self.accessor(root, start, count, (ComponentType::F32, kind), target);
        if bounds && count > 0 {
            root.accessors[index.value()].min = Some(Value::from(low.to_vec()));
            root.accessors[index.value()].max = Some(Value::from(high.to_vec()));
        }
        index
    }

    /// Adds rows of two-byte integers, of four numbers or one.
    pub(crate) fn shorts<const N: usize>(
        &mut self,
        root: &mut Root,
        rows: impl IntoIterator<Item = [u16; N]>,
        target: Target,
    ) -> Index<Accessor> {
        let start = self.bytes.len();
        let numbers = rows.into_iter().flatten();
        self.bytes.extend(numbers.flat_map(u16::to_le_bytes));
        let count = (self.bytes.len() - start) / (2 * N);
        let kind = if N == 1 { Type::Scalar } else { Type::Vec4 };
        self.accessor(root, start, count, (ComponentType::U16, kind), Some(target))
    }

    /// Adds four-byte integers.
    pub(crate) fn integers(
        &mut self,
        root: &mut Root,
        numbers: impl IntoIterator<Item = u32>,
        target: Target,
    ) -> Index<Accessor> {
        let start = self.bytes.len();
        self.bytes
            .extend(numbers.into_iter().flat_map(u32::to_le_bytes));
        let count = (self.bytes.len() - start) / 4;
        let kind = (ComponentType::U32, Type::Scalar);
        self.accessor(root, start, count, kind, Some(target))
    }

    /// Describes the bytes from `start`, and pads them to a whole number of four-byte words.
    fn accessor(
        &mut self,
        root: &mut Root,
        start: usize,
        count: usize,
        (component, kind): (ComponentType, Type),
        target: Option<Target>,
    ) -> Index<Accessor> {
        let view = root.push(View {
            buffer: Index::new(0),
            byte_length: USize64::from(self.bytes.len() - start),
            byte_offset: Some(USize64::from(start)),
            byte_stride: None,
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: None,
        });
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Valid(GenericComponentType(component)),
            extensions: None,
            extras: None,
            type_: Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        })
    }
}

/// The bytes of a GLB file: a header of 12 bytes, the JSON, the arrays. `None` above 4 GiB.
pub(crate) fn container(mut json: Vec<u8>, bytes: &[u8]) -> Option<Vec<u8>> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let length = u32::try_from(12 + 8 + json.len() + 8 + bytes.len()).ok()?;
    let mut file = Vec::with_capacity(length as usize);
    file.extend(b"glTF");
    file.extend(2u32.to_le_bytes());
    file.extend(length.to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json[..]), (b"BIN\0", bytes)] {
        file.extend((chunk.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(chunk);
    }
    Some(file)
}
