//! numpy arrays to slices of the scene's types, without a loop over elements.

use crate::error::{NativeError, invalid};
use bytemuck::AnyBitPattern;
use glam::{Affine3A, Mat3, Mat4};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// A borrowed, C-contiguous numpy array; `name` is for messages.
pub struct Array<'py, T: Element> {
    name: &'static str,
    array: PyReadonlyArrayDyn<'py, T>,
}

impl<'py, T: Element + bytemuck::NoUninit> Array<'py, T> {
    /// Borrows `object`, which must be an array of exactly `T`.
    pub fn borrow(name: &'static str, object: &Bound<'py, PyAny>) -> Result<Self, NativeError> {
        let wrong = || {
            let expected = std::any::type_name::<T>();
            invalid(format!("{name} must be a C-contiguous numpy array of {expected}"))
        };
        let array = object.cast::<PyArrayDyn<T>>().map_err(|_| wrong())?;
        if !array.is_c_contiguous() {
            return Err(wrong());
        }
        let array = array.try_readonly().map_err(|_| invalid(format!("{name} is being written to")))?;
        Ok(Self { name, array })
    }

    /// The elements as they are.
    pub fn values(&self) -> Result<&[T], NativeError> {
        self.array.as_slice().map_err(|_| invalid(format!("{} is not contiguous", self.name)))
    }

    /// The elements regrouped as `U`, for example floats as vectors. Fails if they do not divide evenly.
    pub fn cast<U: AnyBitPattern>(&self) -> Result<&[U], NativeError> {
        let shape = || invalid(format!("{} has shape {:?}", self.name, self.array.shape()));
        bytemuck::try_cast_slice(self.values()?).map_err(|_| shape())
    }

    /// Length of the array along `axis`, 0 where it has no such axis.
    pub fn size(&self, axis: usize) -> usize {
        self.array.shape().get(axis).copied().unwrap_or(0)
    }
}

/// An affine transform from the rows of a 4 x 4 matrix.
pub fn affine_from_rows(rows: [[f32; 4]; 4]) -> Affine3A {
    Affine3A::from_mat4(Mat4::from_cols_array_2d(&rows).transpose())
}

/// A matrix from its rows.
pub fn mat3_from_rows(rows: [[f32; 3]; 3]) -> Mat3 {
    Mat3::from_cols_array_2d(&rows).transpose()
}
