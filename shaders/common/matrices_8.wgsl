enable f16;
enable wgpu_cooperative_matrix;

const SIDE: u32 = 8u;
alias Left = coop_mat8x8<f16, A>;
alias Right = coop_mat8x8<f16, B>;
alias HalfSum = coop_mat8x8<f16, C>;
alias WideSum = coop_mat8x8<f32, C>;
