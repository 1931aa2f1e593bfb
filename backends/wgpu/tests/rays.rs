//! Rays that are not waited for, and devices that the program has opened itself.

mod strict;

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use esvo_core::gpu::kernel::GpuOptions;
use esvo_core::reference::cast_ray;
use esvo_core::testing::compare::{Allowed, Comparison};
use esvo_core::testing::rays::incoherent;
use esvo_core::testing::sample::Sample;
use esvo_core::{CastError, Caster, DeviceKind, Hit, Ray, Rays};
use esvo_format::Octree;
use esvo_wgpu::{PendingHits, WgpuCaster};

/// `None` without a device, which the environment variable `ESVO_REQUIRE_GPU` makes an error.
fn unless_missing<T>(open: impl FnOnce() -> Result<T, CastError>) -> Option<T> {
    strict::listen();
    match open() {
        Ok(opened) => Some(opened),
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

fn reference(octree: &Octree, rays: &[Ray]) -> Vec<Hit> {
    let root = octree.objects()[0].root_slot as u32;
    rays.iter().map(|ray| cast_ray(octree, root, ray, true)).collect()
}

/// Whether these are the reference's hits of these rays.
fn right(octree: &Octree, rays: &[Ray], hits: &[Hit]) -> bool {
    Allowed { share: 0.0, ..Allowed::GPU }.admits(&Comparison::of(hits, &reference(octree, rays)))
}

/// Polls until the hits are there.
fn arrived(caster: &mut WgpuCaster, pending: &mut PendingHits) -> Vec<Hit> {
    let start = Instant::now();
    loop {
        if let Some(hits) = caster.poll(pending).unwrap() {
            return hits;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "no hits after a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn lists_that_are_not_waited_for_arrive_in_any_order() {
    let options = GpuOptions { max_rays: Some(700), ..GpuOptions::default() };
    let Some(mut caster) = unless_missing(|| WgpuCaster::new(&options)) else { return };
    let octrees = [Sample::plain(7, true).octree().unwrap(), Sample::scattered(6, true).octree().unwrap()];
    let lists = [incoherent(500, 1), incoherent(2000, 2), incoherent(1, 3)];
    let nothing = Rays::new(&octrees[0], 0, &[]);
    assert!(matches!(caster.submit_rays(&nothing), Err(CastError::NotLoaded)));
    // Six lists on their way, of two octrees.
    let mut pending = Vec::new();
    for octree in &octrees {
        caster.load(octree).unwrap();
        for list in &lists {
            let rays = Rays::new(octree, 0, list);
            pending.push((octree, list, caster.submit_rays(&rays).unwrap()));
        }
    }
    // Meanwhile other rays are cast and waited for.
    let mut hits = Vec::new();
    caster.cast_rays(&Rays::new(&octrees[1], 0, &lists[0]), &mut hits).unwrap();
    assert!(right(&octrees[1], &lists[0], &hits));
    for (octree, list, pending) in pending.iter_mut().rev() {
        assert!(pending.len() == list.len() && !pending.is_empty());
        let hits = arrived(&mut caster, pending);
        assert!(hits.len() == list.len() && right(octree, list, &hits), "{} rays", list.len());
        // The two octrees tell them apart.
        let other = octrees.iter().find(|other| !Arc::ptr_eq(other, octree)).unwrap();
        assert!(list.len() == 1 || !right(other, list, &hits));
        // They are returned once.
        assert!(pending.is_empty() && caster.poll(pending).unwrap().unwrap().is_empty());
    }
    let mut none = caster.submit_rays(&Rays::new(&octrees[1], 0, &[])).unwrap();
    assert!(none.is_empty() && caster.poll(&mut none).unwrap().unwrap().is_empty());
    let root = Rays { root: 3, ..Rays::new(&octrees[1], 0, &lists[0]) };
    assert!(matches!(caster.submit_rays(&root), Err(CastError::Root { .. })));
}

/// A device as a program opens it, with wgpu's least limits.
fn own_device() -> Result<(wgpu::Device, wgpu::Queue), CastError> {
    let failed = |error: &dyn std::fmt::Display| CastError::Device(error.to_string());
    let descriptor = wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    };
    let instance = wgpu::Instance::new(descriptor);
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
    let adapter = adapter.map_err(|error| failed(&error))?;
    let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()));
    opened.map_err(|error| failed(&error))
}

#[test]
fn a_device_of_the_program_is_used_and_stays_the_program_s() {
    let Some((device, queue)) = unless_missing(own_device) else { return };
    let reports = Arc::new(AtomicU32::new(0));
    let counted = reports.clone();
    device.on_uncaptured_error(Arc::new(move |_| {
        counted.fetch_add(1, Ordering::Relaxed);
    }));
    let octree = Sample::plain(7, true).octree().unwrap();
    let rays = incoherent(1000, 4);
    let list = Rays::new(&octree, 0, &rays);

    let mut caster = WgpuCaster::from_device(device.clone(), queue.clone(), &GpuOptions::default());
    assert!(caster.device().name == device.adapter_info().name && caster.device().kind != DeviceKind::Cpu);
    caster.load(&octree).unwrap();
    let mut hits = Vec::new();
    caster.cast_rays(&list, &mut hits).unwrap();
    assert!(right(&octree, &rays, &hits));
    let mut pending = caster.submit_rays(&list).unwrap();
    assert_eq!(arrived(&mut caster, &mut pending), hits);

    // The caster's errors are its own: the program's callback hears nothing of them.
    let broken = GpuOptions { kernel: Some("no kernel".into()), ..GpuOptions::default() };
    let mut second = WgpuCaster::from_device(device.clone(), queue, &broken);
    second.load(&octree).unwrap();
    assert!(matches!(second.cast_rays(&list, &mut hits), Err(CastError::Device(_))));
    assert_eq!(reports.load(Ordering::Relaxed), 0);
    // And the program's errors are the program's.
    let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::STORAGE;
    let _ = device.create_buffer(&wgpu::BufferDescriptor { label: None, size: 64, usage, mapped_at_creation: false });
    assert_eq!(reports.load(Ordering::Relaxed), 1);
    caster.cast_rays(&list, &mut hits).unwrap();
    assert!(right(&octree, &rays, &hits));
}
