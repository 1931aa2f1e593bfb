//! An open device.

use std::sync::{Arc, Mutex, PoisonError};

use esvo_core::Device;
use esvo_core::gpu::choice::choose;
use wgpu::{ErrorFilter, Features};

use crate::adapter::{describe, describe_as, found};
use crate::error::DeviceError;

/// An open device and its queue.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    about: Device,
    limits: wgpu::Limits,
    reports: Arc<Mutex<Reports>>,
    /// Whether wgpu reports to the owner of the device what no scope catches.
    borrowed: bool,
}

/// What wgpu's callbacks reported.
#[derive(Default)]
struct Reports {
    /// The first error that no scope caught.
    error: Option<DeviceError>,
    /// Set once, stays.
    lost: Option<DeviceError>,
}

fn lock(reports: &Mutex<Reports>) -> std::sync::MutexGuard<'_, Reports> {
    reports.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gpu {
    /// Opens the first device whose name contains `name`, whatever its case; with `None`, the best of [`adapters`].
    ///
    /// [`adapters`]: crate::adapters
    ///
    /// # Errors
    /// [`DeviceError::NotFound`] without a device, or without one of that name; [`DeviceError::NotOpened`].
    pub fn open(name: Option<&str>) -> Result<Self, DeviceError> {
        Self::open_with(name, Features::empty())
    }

    /// The same with those of the `wanted` features that the device has; see [`features`](Self::features). Timestamp
    /// queries are always wanted.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_with(name: Option<&str>, wanted: Features) -> Result<Self, DeviceError> {
        let mut adapters = found();
        let devices: Vec<Device> = adapters.iter().map(describe).collect();
        let index = choose(&devices, name).map_err(|error| DeviceError::NotFound(error.to_string()))?;
        let (adapter, about) = (adapters.swap_remove(index), devices[index].clone());
        let descriptor = wgpu::DeviceDescriptor {
            required_features: adapter.features() & (wanted | Features::TIMESTAMP_QUERY),
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| DeviceError::NotOpened { device: about.name.clone(), message: error.to_string() })?;
        let reports = Arc::new(Mutex::new(Reports::default()));
        let (to, name) = (reports.clone(), about.name.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock(&to).error.get_or_insert(DeviceError::reported(&name, &error));
        }));
        let (to, name) = (reports.clone(), about.name.clone());
        device.set_device_lost_callback(move |_, message| {
            lock(&to).lost.get_or_insert(DeviceError::Lost { device: name.clone(), message });
        });
        let limits = descriptor.required_limits;
        Ok(Self { device, queue, about, limits, reports, borrowed: false })
    }

    /// Uses a device that the program has opened, and its queue: handles of both, so that buffers of either can be used
    /// together. Timestamps are there if the device has the feature `TIMESTAMP_QUERY`; limits are those of the device.
    ///
    /// The device's callbacks for uncaptured errors and for its loss stay those of the program. Errors that the calls of this
    /// crate cause are returned by these calls and not passed to the callbacks.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let (about, limits) = (describe_as(device.adapter_info(), device.features()), device.limits());
        Self { device, queue, about, limits, reports: Arc::default(), borrowed: true }
    }

    /// wgpu's device, for what this crate does not wrap. Make objects within [`checked`](Self::checked), or call
    /// [`check`](Self::check) afterwards.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// wgpu's queue, with the same care; see also [`write`](Self::write) and [`submit`](Self::submit).
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Name, kind and driver.
    pub fn about(&self) -> &Device {
        &self.about
    }

    /// The limits of the device: the largest that it offers.
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// The features that are switched on.
    pub fn features(&self) -> Features {
        self.device.features()
    }

    /// Largest number of bytes that a shader may see as one storage binding.
    pub fn max_storage_bytes(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// An error of this device in the words of `message`.
    pub fn error(&self, message: impl ToString) -> DeviceError {
        DeviceError::Invalid { device: self.about.name.clone(), message: message.to_string() }
    }

    /// The first error that was reported since the last call and that no other call returned.
    ///
    /// # Errors
    /// That one; [`DeviceError::Lost`] at every call once the device is lost.
    pub fn check(&self) -> Result<(), DeviceError> {
        let mut reports = lock(&self.reports);
        let error = reports.error.take();
        match reports.lost.clone().or(error) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Makes something with wgpu's device and returns what wgpu says of it.
    ///
    /// Errors of other threads are not mistaken for errors of `make`: wgpu's error scopes belong to a thread.
    ///
    /// # Errors
    /// The first that `make` caused; one that was reported earlier and not returned yet.
    pub fn checked<T>(&self, make: impl FnOnce(&wgpu::Device) -> T) -> Result<T, DeviceError> {
        let filters = [ErrorFilter::Internal, ErrorFilter::OutOfMemory, ErrorFilter::Validation];
        let scopes = filters.map(|filter| self.device.push_error_scope(filter));
        let made = make(&self.device);
        // In reverse order, as wgpu demands; each scope has at most one error.
        let mut errors =
            scopes.into_iter().rev().filter_map(|scope| pollster::block_on(scope.pop())).collect::<Vec<_>>();
        // The loss of a device is reported when it is polled.
        if let Err(error) = self.device.poll(wgpu::PollType::Poll) {
            return self.check().and(Err(self.error(error)));
        }
        self.check()?;
        match errors.pop() {
            Some(error) => Err(DeviceError::reported(&self.about.name, &error)),
            None => Ok(made),
        }
    }

    /// A call of wgpu that does not return its errors. On a borrowed device they would go to the program's callback:
    /// they are caught. On a device of one's own, [`check`](Self::check) returns them later.
    pub(crate) fn caught<T>(&self, call: impl FnOnce(&wgpu::Device) -> T) -> Result<T, DeviceError> {
        if self.borrowed { self.checked(call) } else { Ok(call(&self.device)) }
    }

    /// Records commands and submits them, but does not wait for them.
    ///
    /// # Errors
    /// Commands that are not valid; a lost device.
    pub fn submit(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<(), DeviceError> {
        self.caught(|device| {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            record(&mut encoder);
            self.queue.submit([encoder.finish()]);
        })?;
        self.check()
    }

    /// Lets the device deliver what is ready, and does not wait.
    ///
    /// # Errors
    /// What the device reported meanwhile; a lost device.
    pub fn poll(&self) -> Result<(), DeviceError> {
        let polled = self.device.poll(wgpu::PollType::Poll);
        self.check()?;
        polled.map(|_| ()).map_err(|error| self.error(error))
    }

    /// Waits until everything that was submitted is done.
    ///
    /// # Errors
    /// What the device reported meanwhile; a lost device.
    pub fn wait(&self) -> Result<(), DeviceError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled.map(|_| ()).map_err(|error| self.error(error))
    }

    /// Records commands, submits them and waits until they are done.
    ///
    /// # Errors
    /// As [`submit`](Self::submit) and [`wait`](Self::wait).
    pub fn run(&self, record: impl FnOnce(&mut wgpu::CommandEncoder)) -> Result<(), DeviceError> {
        self.submit(record)?;
        self.wait()
    }

    /// Whether passes can be timed by the device itself.
    pub fn has_clock(&self) -> bool {
        self.features().contains(Features::TIMESTAMP_QUERY)
    }
}
