//! Arguments of the kernels: twins of the `Arguments` of `shaders/gather/*.wgsl`, which tell what the fields are.

use bytemuck::NoUninit;

macro_rules! arguments {
    ($($name:ident { $($field:ident),* $(,)? })*) => {
        $(#[repr(C)]
        #[derive(Clone, Copy, Debug, NoUninit)]
        pub struct $name { $(pub $field: u32),* })*
    };
}

arguments! {
    ImagesArguments { pixels, first_light, lights, stride }
    TargetsArguments { targets, lights, first_light, count, sharing }
    SlopesArguments { cells, columns, edge, width, height, light }
    WorldArguments { pixels }
    NumbersArguments { pixels }
}

#[cfg(test)]
mod tests {
    use relume_gpu::assert_mirror;

    use super::*;

    #[test]
    fn arguments_have_the_layout_of_their_wgsl_twins() {
        assert_mirror!(ImagesArguments as "gather/images", "Arguments", { pixels, first_light, lights, stride });
        assert_mirror!(TargetsArguments as "gather/targets", "Arguments", {
            targets, lights, first_light, count, sharing,
        });
        assert_mirror!(SlopesArguments as "gather/slopes", "Arguments", {
            cells, columns, edge, width, height, light,
        });
        assert_mirror!(WorldArguments as "gather/world", "Arguments", { pixels });
        assert_mirror!(NumbersArguments as "gather/numbers", "Arguments", { pixels });
    }
}
