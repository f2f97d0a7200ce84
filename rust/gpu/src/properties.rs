use crate::Gpu;

/// Number that a driver states of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Property {
    /// Name of the property.
    pub name: String,
    /// The number; 1 and 0 are yes and no.
    pub value: f64,
}

impl Gpu {
    /// Limits and features that decide which kernels run and how large they may be, and all matrices that its subgroups multiply.
    pub fn properties(&self) -> Vec<Property> {
        let (all, limits) = (self.adapter().limits(), self.limits());
        let yes = |is: bool| f64::from(u8::from(is));
        let subgroup = limits.subgroup.unwrap_or_default();
        let mut properties: Vec<(String, f64)> = [
            ("bytes that our buffers may take", self.free_memory() as f64),
            ("bytes of a buffer", all.max_buffer_size as f64),
            ("bytes of a buffer that can be bound", limits.buffer as f64),
            ("buffers of a kernel", f64::from(all.max_storage_buffers_per_shader_stage)),
            ("bytes of workgroup memory", f64::from(limits.workgroup_memory)),
            ("invocations of a workgroup", f64::from(limits.invocations)),
            ("invocations of the smallest subgroup", f64::from(subgroup.0)),
            ("invocations of the largest subgroup", f64::from(subgroup.1)),
            ("bytes of push constants", f64::from(all.max_immediate_size)),
            ("16-bit floats in kernels", yes(limits.f16)),
            ("atomic additions of 32-bit floats", yes(limits.float_atomics)),
            ("times on the device", yes(limits.timestamps)),
            ("side of the matrices that kernels here multiply", f64::from(limits.matrices.unwrap_or(0))),
            ("invocations of a subgroup that does", f64::from(self.matrices().map_or(0, |m| m.subgroup))),
        ]
        .map(|(name, value)| (name.to_owned(), value))
        .into();
        for matrix in self.adapter().cooperative_matrix_properties() {
            let size = format!("{} x {} x {}", matrix.m_size, matrix.n_size, matrix.k_size);
            properties.push((format!("matrices {size}, {:?} to {:?}", matrix.ab_type, matrix.cr_type), 1.0));
        }
        properties.into_iter().map(|(name, value)| Property { name, value }).collect()
    }
}
