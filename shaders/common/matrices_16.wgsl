enable f16;
enable wgpu_cooperative_matrix;

const SIDE: u32 = 16u;
alias Left = coop_mat16x16<f16, A>;
alias Right = coop_mat16x16<f16, B>;
alias HalfSum = coop_mat16x16<f16, C>;
alias WideSum = coop_mat16x16<f32, C>;
