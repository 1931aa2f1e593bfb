//! Shaders, bind groups and compute pipelines.

use crate::error::DeviceError;
use crate::gpu::Gpu;

/// Entry of a bind group layout: a uniform buffer that compute shaders see.
///
/// For other stages: `wgpu::BindGroupLayoutEntry { visibility, ..uniform(0) }`.
pub fn uniform(binding: u32) -> wgpu::BindGroupLayoutEntry {
    entry(binding, wgpu::BufferBindingType::Uniform)
}

/// Entry of a bind group layout: a storage buffer that compute shaders see.
pub fn storage(binding: u32, read_only: bool) -> wgpu::BindGroupLayoutEntry {
    entry(binding, wgpu::BufferBindingType::Storage { read_only })
}

fn entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

impl Gpu {
    /// Compiles WGSL.
    ///
    /// # Errors
    /// [`DeviceError::Invalid`] with the line of the source.
    pub fn shader(&self, label: &str, source: &str) -> Result<wgpu::ShaderModule, DeviceError> {
        self.checked(|device| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(label),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            })
        })
    }

    /// Makes a layout of these entries; see [`uniform`] and [`storage`].
    ///
    /// # Errors
    /// Two entries for one binding; more than the device allows.
    pub fn bind_group_layout(
        &self,
        label: &str,
        entries: &[wgpu::BindGroupLayoutEntry],
    ) -> Result<wgpu::BindGroupLayout, DeviceError> {
        let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some(label), entries };
        self.checked(|device| device.create_bind_group_layout(&descriptor))
    }

    /// Binds whole buffers: buffer `i` at binding `i`.
    ///
    /// # Errors
    /// Buffers that do not fit the layout.
    pub fn bind_group(
        &self,
        layout: &wgpu::BindGroupLayout,
        buffers: &[&wgpu::Buffer],
    ) -> Result<wgpu::BindGroup, DeviceError> {
        self.bind_resources(layout, buffers.iter().map(|buffer| buffer.as_entire_binding()).collect())
    }

    /// Binds buffers and textures: resource `i` at binding `i`.
    ///
    /// # Errors
    /// Resources that do not fit the layout.
    pub fn bind_resources(
        &self,
        layout: &wgpu::BindGroupLayout,
        resources: Vec<wgpu::BindingResource<'_>>,
    ) -> Result<wgpu::BindGroup, DeviceError> {
        let entry = |(binding, resource)| wgpu::BindGroupEntry { binding, resource };
        let entries: Vec<_> = (0..).zip(resources).map(entry).collect();
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
        self.checked(|device| device.create_bind_group(&descriptor))
    }

    /// Makes the pipeline of a compute shader's entry point, for bind groups of these layouts from group 0.
    ///
    /// # Errors
    /// No such entry point; layouts that do not fit the shader; what the driver's compiler reports.
    pub fn compute_pipeline(
        &self,
        module: &wgpu::ShaderModule,
        entry: &str,
        layouts: &[&wgpu::BindGroupLayout],
    ) -> Result<wgpu::ComputePipeline, DeviceError> {
        let layouts: Vec<_> = layouts.iter().map(|&layout| Some(layout)).collect();
        self.checked(|device| {
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(entry),
                bind_group_layouts: &layouts,
                immediate_size: 0,
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        })
    }
}
