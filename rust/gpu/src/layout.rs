//! Layout that WGSL gives to the fields of a struct, to be compared with its Rust mirror.

use crate::{GpuError, modules};

/// A struct of a module: its size in bytes, and its fields in the order of the declaration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Bytes.
    pub size: u32,
    /// The fields.
    pub fields: Vec<FieldLayout>,
}

/// A field of a struct.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldLayout {
    /// Name of the field.
    pub name: String,
    /// Start of the field, bytes.
    pub offset: u32,
    /// Components, and where they lie in the struct, bytes.
    pub components: Vec<(u32, ComponentType)>,
}

/// Type of a component.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ComponentType {
    /// `f32`
    F32,
    /// `i32`
    I32,
    /// `u32`
    U32,
    /// A struct, which has a mirror of its own.
    Struct,
    /// Anything else, which no mirror has.
    Other,
}

impl StructLayout {
    /// Fault of a Rust mirror of this: its size, or its first field that differs. A field of the mirror may be longer
    /// by what fills up the room to the next one, as `[f32; 4]` for a `vec3f`.
    pub fn difference(&self, mirror: &Self) -> Option<String> {
        let pairs = self.fields.iter().zip(&mirror.fields);
        let differs = |(wgsl, rust): &(&FieldLayout, &FieldLayout)| {
            (&wgsl.name, wgsl.offset) != (&rust.name, rust.offset)
                || wgsl.components.iter().any(|part| !rust.components.contains(part))
        };
        if let Some((wgsl, rust)) = pairs.clone().find(differs) {
            return Some(format!("{rust:?} should be {wgsl:?}"));
        }
        let sizes = |layout: &Self| (layout.size, layout.fields.len());
        (sizes(self) != sizes(mirror))
            .then(|| format!("bytes and fields are {:?} and should be {:?}", sizes(mirror), sizes(self)))
    }
}

/// A Rust type of a field of a mirror.
pub trait Field {
    /// Appends what it is made of, if it lies `at` so many bytes.
    fn add_parts(at: u32, components: &mut Vec<(u32, ComponentType)>);
}

/// Types that are one part.
#[macro_export]
macro_rules! part_of_mirrors {
    ($($type:ty as $part:ident),* $(,)?) => {
        $(impl $crate::layout::Field for $type {
            fn add_parts(at: u32, components: &mut Vec<(u32, $crate::layout::ComponentType)>) {
                components.push((at, $crate::layout::ComponentType::$part));
            }
        })*
    };
}

part_of_mirrors!(f32 as F32, i32 as I32, u32 as U32);

impl<T: Field, const N: usize> Field for [T; N] {
    fn add_parts(at: u32, components: &mut Vec<(u32, ComponentType)>) {
        (0..N).for_each(|index| T::add_parts(at + (index * size_of::<T>()) as u32, components));
    }
}

/// A field of a Rust struct, which `_get` names: only its type counts.
pub fn field<S, F: Field>(name: &str, offset: usize, _get: fn(&S) -> &F) -> FieldLayout {
    let mut components = Vec::new();
    F::add_parts(offset as u32, &mut components);
    FieldLayout { name: name.to_owned(), offset: offset as u32, components }
}

/// The layout of a struct as WGSL's rules have it.
///
/// # Errors
/// If the module is not valid, or has no such struct.
pub fn of(module: &str, name: &str) -> Result<StructLayout, GpuError> {
    let parsed = modules::validate(module, &[])?;
    let found = parsed.types.iter().find_map(|(_, ty)| match (&ty.name, &ty.inner) {
        (Some(found), naga::TypeInner::Struct { members, span }) if found == name => {
            let field = |member: &naga::StructMember| {
                let mut components = Vec::new();
                add_wgsl_components(&parsed, member.ty, member.offset, &mut components);
                FieldLayout {
                    name: member.name.clone().unwrap_or_default(),
                    offset: member.offset,
                    components,
                }
            };
            Some(StructLayout { size: *span, fields: members.iter().map(field).collect() })
        }
        _ => None,
    });
    found.ok_or_else(|| GpuError::Shader {
        module: module.to_owned(),
        reason: format!("it has no struct {name}"),
    })
}

/// Appends what a WGSL type is made of, if it lies `at` so many bytes.
fn add_wgsl_components(
    module: &naga::Module,
    ty: naga::Handle<naga::Type>,
    at: u32,
    components: &mut Vec<(u32, ComponentType)>,
) {
    use naga::TypeInner;
    let vector = |at: u32, size: naga::VectorSize, scalar: naga::Scalar| {
        (0..size as u32).map(move |lane| (at + lane * u32::from(scalar.width), component_of(scalar)))
    };
    match module.types[ty].inner {
        TypeInner::Scalar(scalar) => components.push((at, component_of(scalar))),
        TypeInner::Vector { size, scalar } => components.extend(vector(at, size, scalar)),
        TypeInner::Matrix { columns, rows, scalar } => {
            // Columns of three lie like those of four.
            let stride = (rows as u32).next_power_of_two() * u32::from(scalar.width);
            components
                .extend((0..columns as u32).flat_map(|column| vector(at + column * stride, rows, scalar)));
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(count), stride } => {
            (0..count.get())
                .for_each(|index| add_wgsl_components(module, base, at + index * stride, components));
        }
        TypeInner::Struct { .. } => components.push((at, ComponentType::Struct)),
        _ => components.push((at, ComponentType::Other)),
    }
}

fn component_of(scalar: naga::Scalar) -> ComponentType {
    match scalar {
        naga::Scalar::F32 => ComponentType::F32,
        naga::Scalar::I32 => ComponentType::I32,
        naga::Scalar::U32 => ComponentType::U32,
        _ => ComponentType::Other,
    }
}

/// The value of a `const` of a module: a number of type `u32`.
///
/// # Errors
/// If the module is not valid, or has no such constant.
pub fn constant(module: &str, name: &str) -> Result<u32, GpuError> {
    let parsed = modules::validate(module, &[])?;
    let found = parsed.constants.iter().find_map(|(_, constant)| {
        let is_meant = constant.name.as_deref() == Some(name);
        match parsed.global_expressions[constant.init] {
            naga::Expression::Literal(naga::Literal::U32(value)) if is_meant => Some(value),
            _ => None,
        }
    });
    found.ok_or_else(|| GpuError::Shader {
        module: module.to_owned(),
        reason: format!("it has no number {name}"),
    })
}

/// Panics unless a Rust struct has the size and the fields, of the same types at the same places, of its WGSL struct.
///
/// ```text
/// relume_gpu::assert_mirror!(Light as "gather/gather", "Light", { center, radius });
/// ```
#[macro_export]
macro_rules! assert_mirror {
    ($rust:ty as $module:literal, $name:literal, { $($field:ident),* $(,)? }) => {
        let fields = vec![$(
            $crate::layout::field(
                stringify!($field), std::mem::offset_of!($rust, $field), |mirror: &$rust| &mirror.$field,
            )
        ),*];
        let mirror = $crate::layout::StructLayout { size: size_of::<$rust>() as u32, fields };
        let difference = $crate::layout::of($module, $name).unwrap().difference(&mirror);
        assert_eq!(difference, None, "{} and {} of {}.wgsl", stringify!($rust), $name, $module);
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Layout of `Light` in `gather/light.wgsl`, whose first fields are `center: vec3f`, `kind: u32`.
    #[test]
    fn a_mirror_whose_fields_have_other_types_is_told_from_its_wgsl_struct() {
        let whole = of("gather/light", "Light").unwrap();
        let differs = |field: usize, components: &[(u32, ComponentType)]| {
            let mut other = whole.clone();
            other.fields[field].components = components.to_vec();
            whole.difference(&other)
        };
        use ComponentType::{F32, I32, U32};
        assert_eq!(whole.difference(&whole), None);
        assert_eq!(differs(0, &[(0, F32), (4, F32), (8, F32)]), None);
        assert!(differs(0, &[(0, F32), (4, F32), (8, U32)]).unwrap().contains("center"));
        assert!(differs(0, &[(0, F32), (4, F32)]).is_some(), "a vector of two");
        assert!(differs(1, &[(12, F32)]).unwrap().contains("kind"));
        assert!(differs(1, &[(12, I32)]).is_some());
        let factors = whole.fields.iter().position(|field| field.name == "factors").unwrap();
        assert_eq!(whole.fields[factors].components, [0, 1, 2, 3, 4, 5, 6, 7].map(|i| (64 + 4 * i, F32)));
        let mut shorter = whole.clone();
        shorter.fields.pop();
        assert!(whole.difference(&shorter).unwrap().contains("bytes and fields"));
    }

    #[test]
    #[should_panic(expected = "Broken and Arguments of common/mean.wgsl")]
    fn a_mirror_of_whole_numbers_for_floats_is_not_taken() {
        #[repr(C)]
        struct Broken {
            values: u32,
            share: u32,
            scale: f32,
        }
        assert_mirror!(Broken as "common/mean", "Arguments", { values, share, scale });
    }

    #[test]
    fn types_of_both_languages_are_made_of_the_same_parts() {
        use ComponentType::{F32, Struct, U32};
        #[repr(C)]
        struct Rust {
            number: u32,
            rows: [[f32; 2]; 2],
            part: Inner,
        }
        struct Inner(#[expect(dead_code, reason = "only its type counts")] u32);
        part_of_mirrors!(Inner as Struct);
        let rows = [(4, F32), (8, F32), (12, F32), (16, F32)];
        let fields = [
            field("number", 0, |rust: &Rust| &rust.number),
            field("rows", 4, |rust: &Rust| &rust.rows),
            field("part", 20, |rust: &Rust| &rust.part),
        ];
        let components = fields.map(|field| field.components);
        assert_eq!(components, [vec![(0, U32)], rows.to_vec(), vec![(20, Struct)]]);
        // Columns of a matrix of three rows are four floats apart; the mirror fills them up.
        let environment = of("gather/world", "Environment").unwrap();
        let columns = [0, 16, 32].map(|at| [at, at + 4, at + 8]).concat();
        assert!(environment.fields[0].components.iter().map(|component| component.0).eq(columns));
        let mut filled = environment.clone();
        filled.fields[0].components.push((12, F32));
        assert_eq!(environment.difference(&filled), None);
        assert_eq!(of("train/inputs", "Inputs").unwrap().fields[0].components, [(0, Struct)]);
    }
}
