//! numpy arrays to slices of the scene's types, without a loop over elements.

use crate::error::{NativeError, invalid};
use bytemuck::AnyBitPattern;
use glam::{Affine3A, Mat3, Mat4, Vec2};
use numpy::{Element, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

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

/// Values of an array, if there is one.
pub fn owned<T: AnyBitPattern>(argument: &'static str, array: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<T>> {
    array.map_or(Ok(Vec::new()), |array| Ok(Array::<f32>::borrow(argument, array)?.cast()?.to_vec()))
}

/// UV maps of a dictionary, in its order.
pub fn owned_uv_maps(maps: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<relume_scene::UvMap>> {
    let arrays = named_arrays("uv_maps", maps)?;
    let maps = regrouped::<Vec2>(&arrays)?.into_iter();
    Ok(maps.map(|(name, coords)| relume_scene::UvMap { name, coords: coords.to_vec() }).collect())
}

/// Attributes of a dictionary, in its order.
pub fn owned_attributes(
    argument: &'static str,
    attributes: Option<&Bound<'_, PyDict>>,
) -> PyResult<Vec<relume_scene::ColorAttribute>> {
    let arrays = named_arrays(argument, attributes)?;
    let attributes = regrouped::<[f32; 4]>(&arrays)?.into_iter();
    Ok(attributes
        .map(|(name, colors)| relume_scene::ColorAttribute { name, colors: colors.to_vec() })
        .collect())
}

/// The arrays of a dictionary, in its order.
pub fn named_arrays<'py>(
    argument: &'static str,
    arrays: Option<&Bound<'py, PyDict>>,
) -> PyResult<Vec<(String, Array<'py, f32>)>> {
    let entry = |(name, array): (Bound<'py, PyAny>, Bound<'py, PyAny>)| {
        Ok((name.extract()?, Array::borrow(argument, &array)?))
    };
    arrays.into_iter().flatten().map(entry).collect()
}

/// Arrays with their elements regrouped as `T`.
pub fn regrouped<'a, T: AnyBitPattern>(
    arrays: &'a [(String, Array<'_, f32>)],
) -> PyResult<Vec<(String, &'a [T])>> {
    arrays.iter().map(|(name, array)| Ok((name.clone(), array.cast()?))).collect()
}
