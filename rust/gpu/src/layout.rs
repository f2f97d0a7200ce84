//! Where WGSL puts the fields of a struct, to be compared with its Rust mirror.

use crate::{GpuError, modules};

/// A struct of a module: its size in bytes, and the offset of every field by name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructLayout {
    /// Bytes.
    pub size: u32,
    /// Name and offset in bytes, in the order of the declaration.
    pub fields: Vec<(String, u32)>,
}

/// The layout of a struct as WGSL's rules have it.
///
/// # Errors
/// If the module is not valid, or has no such struct.
pub fn of(module: &str, name: &str) -> Result<StructLayout, GpuError> {
    let parsed = modules::validate(module, &[])?;
    let found = parsed.types.iter().find_map(|(_, ty)| match (&ty.name, &ty.inner) {
        (Some(found), naga::TypeInner::Struct { members, span }) if found == name => {
            let field =
                |member: &naga::StructMember| (member.name.clone().unwrap_or_default(), member.offset);
            Some(StructLayout { size: *span, fields: members.iter().map(field).collect() })
        }
        _ => None,
    });
    found.ok_or_else(|| GpuError::Shader {
        module: module.to_owned(),
        reason: format!("it has no struct {name}"),
    })
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

/// Panics unless a Rust struct has the size and the fields, at the same places, of its WGSL twin.
///
/// ```text
/// relume_gpu::assert_mirror!(Light as "gather/gather", "Light", { center, radius });
/// ```
#[macro_export]
macro_rules! assert_mirror {
    ($rust:ty as $module:literal, $name:literal, { $($field:ident),* $(,)? }) => {
        let layout = $crate::layout::of($module, $name).unwrap();
        let fields = vec![$((stringify!($field).to_owned(), std::mem::offset_of!($rust, $field) as u32)),*];
        let mirror = $crate::layout::StructLayout { size: size_of::<$rust>() as u32, fields };
        assert_eq!(mirror, layout, "{} and {} of {}.wgsl", stringify!($rust), $name, $module);
    };
}
