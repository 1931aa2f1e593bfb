//! Whatever device there is: it computes, it is timed, and what it cannot do is an error.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use esvo_core::DeviceKind;
use esvo_device::{DeviceError, Gpu, Usage, adapters, read_texture, storage, uniform, wgpu};

/// The device, if there is one. The environment variable `ESVO_REQUIRE_GPU` demands one.
fn gpu() -> Option<Gpu> {
    match Gpu::open(None) {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("ESVO_REQUIRE_GPU").is_some() => panic!("{error}"),
        Err(error) => {
            eprintln!("skipped: {error}");
            None
        }
    }
}

/// Changes each number 1024 times, so that a pass takes long enough to be timed.
const MIX: &str = "
    @group(0) @binding(0) var<uniform> step: vec4<u32>;
    @group(0) @binding(1) var<storage, read_write> numbers: array<u32>;
    @compute @workgroup_size(64) fn mix(@builtin(global_invocation_id) id: vec3<u32>) {
        if id.x < arrayLength(&numbers) {
            for (var i = 0u; i < 1024u; i += 1u) { numbers[id.x] = numbers[id.x] ^ (step.x + i); }
        }
    }";

/// What the shader computes.
fn expected(number: u32, step: u32) -> u32 {
    (0..1024).fold(number, |number, i| number ^ (step + i))
}

/// A shader at work on a buffer of 1000 numbers.
struct Work {
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    numbers: wgpu::Buffer,
}

const COUNT: u32 = 1000;

impl Work {
    fn new(gpu: &Gpu) -> Result<Self, DeviceError> {
        let layout = gpu.bind_group_layout("work", &[uniform(0), storage(1, false)])?;
        let pipeline = gpu.compute_pipeline(&gpu.shader("mix", MIX)?, "mix", &[&layout])?;
        let step = gpu.upload("step", &[12345u32, 0, 0, 0], Usage::UNIFORM)?;
        let numbers: Vec<u32> = (0..COUNT).collect();
        let numbers = gpu.upload("numbers", &numbers, Usage::STORAGE | Usage::COPY_SRC)?;
        let group = gpu.bind_group(&layout, &[&step, &numbers])?;
        Ok(Self { pipeline, group, numbers })
    }

    fn record(&self, commands: &mut wgpu::CommandEncoder, times: Option<wgpu::ComputePassTimestampWrites<'_>>) {
        let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes: times };
        let mut pass = commands.begin_compute_pass(&descriptor);
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.group, &[]);
        pass.dispatch_workgroups(COUNT.div_ceil(64), 1, 1);
    }
}

#[test]
fn a_shader_computes() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let work = Work::new(&gpu)?;
    gpu.run(|commands| work.record(commands, None))?;
    let found = gpu.read::<u32>(&work.numbers, COUNT as usize)?;
    assert!(found.iter().zip(0..).all(|(&found, number)| found == expected(number, 12345)));
    assert_eq!(gpu.read::<u32>(&work.numbers, 3)?, found[..3]);
    assert!(gpu.read::<u32>(&work.numbers, 0)?.is_empty());
    Ok(())
}

/// Copies texels: `found[i]` is that of slot `wanted[i]`, in rows of 1024.
const TEXELS: &str = "
    @group(0) @binding(0) var<storage, read> wanted: array<u32>;
    @group(0) @binding(1) var<storage, read_write> found: array<vec2<u32>>;
    @group(1) @binding(0) var texels: texture_storage_2d<rg32uint, read>;
    @compute @workgroup_size(64) fn copy(@builtin(global_invocation_id) id: vec3<u32>) {
        if id.x < arrayLength(&wanted) {
            let slot = wanted[id.x];
            found[id.x] = textureLoad(texels, vec2<u32>(slot & 1023u, slot >> 10u)).xy;
        }
    }";

#[test]
fn textures_arrive_in_pieces() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let format = wgpu::TextureFormat::Rg32Uint;
    // More than the device is given at once; the last row is not full.
    let data: Vec<[u32; 2]> = (0..(9 << 20) - 500).map(|i| [i, !i]).collect();
    if gpu.limits().max_texture_dimension_2d < 9 << 10 {
        eprintln!("skipped: textures of this device are too small");
        return Ok(());
    }
    let texture = gpu.upload_texture("numbers", format, 1024, &data)?;
    let last = data.len() as u32 - 1;
    let wanted: Vec<u32> = (0..=last).step_by(99_991).chain([1023, 1024, (8 << 20) - 1, 8 << 20, last]).collect();
    let layout = gpu.bind_group_layout("buffers", &[storage(0, true), storage(1, false)])?;
    let texels = gpu.bind_group_layout("texels", &[read_texture(0, format)])?;
    let pipeline = gpu.compute_pipeline(&gpu.shader("copy", TEXELS)?, "copy", &[&layout, &texels])?;
    let slots = gpu.upload("wanted", &wanted, Usage::STORAGE)?;
    let found = gpu.buffer("found", 8 * wanted.len() as u64, Usage::STORAGE | Usage::COPY_SRC)?;
    let groups = [
        gpu.bind_group(&layout, &[&slots, &found])?,
        gpu.bind_resources(&texels, vec![wgpu::BindingResource::TextureView(&texture)])?,
    ];
    gpu.run(|commands| {
        let mut pass = commands.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        for (number, group) in (0..).zip(&groups) {
            pass.set_bind_group(number, group, &[]);
        }
        pass.dispatch_workgroups((wanted.len() as u32).div_ceil(64), 1, 1);
    })?;
    let expected: Vec<_> = wanted.iter().map(|&slot| data[slot as usize]).collect();
    assert_eq!(gpu.read::<[u32; 2]>(&found, wanted.len())?, expected);
    Ok(())
}

#[test]
fn impossible_textures_are_errors() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let format = wgpu::TextureFormat::Rg32Uint;
    assert!(gpu.upload_texture("texels of another size", format, 8, &[0u32; 8]).is_err());
    assert!(gpu.upload_texture("no columns", format, 0, &[0u64; 8]).is_err());
    assert!(gpu.upload_texture("too wide", format, 1 << 20, &[0u64; 8]).is_err());
    gpu.upload_texture("as the device allows", format, 8, &[0u64; 9])?;
    Ok(())
}

#[test]
fn data_of_every_length_arrives() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    for length in [0, 1, 2, 3, 4, 5, 4096, 70_001] {
        let data: Vec<u8> = (0..length).map(|i| (i * 31 % 251) as u8).collect();
        let buffer = gpu.upload("bytes", &data, Usage::STORAGE | Usage::COPY_SRC)?;
        assert_eq!(buffer.size(), (length as u64).div_ceil(4).max(1) * 4);
        assert_eq!(gpu.read::<u8>(&buffer, data.len())?, data, "{length} bytes");
    }
    Ok(())
}

#[test]
fn data_is_uploaded_in_pieces() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    // A little more than a piece of 64 MiB.
    let data: Vec<u64> = (0..(8 << 20) + 3).map(|i| i * 0x1_0000_0001).collect();
    let buffer = gpu.upload("numbers", &data, Usage::STORAGE | Usage::COPY_SRC)?;
    assert!(gpu.read::<u64>(&buffer, data.len())? == data);
    Ok(())
}

#[test]
fn shaders_and_pipelines_that_are_not_valid_are_errors() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let invalid = |error: DeviceError, says: &str| match error {
        DeviceError::Invalid { device, message } => {
            assert_eq!(device, gpu.about().name);
            assert!(message.contains(says), "{message}");
        }
        other => panic!("{other:?}"),
    };
    invalid(gpu.shader("broken", "fn double( {").unwrap_err(), "double( {");
    invalid(gpu.shader("broken", "fn f() -> u32 { return unknown; }").unwrap_err(), "unknown");
    let module = gpu.shader("mix", MIX)?;
    let layout = gpu.bind_group_layout("work", &[uniform(0), storage(1, false)])?;
    invalid(gpu.compute_pipeline(&module, "blend", &[&layout]).unwrap_err(), "blend");
    invalid(gpu.compute_pipeline(&module, "mix", &[]).unwrap_err(), "");
    invalid(gpu.bind_group_layout("twice", &[storage(0, true), storage(0, true)]).unwrap_err(), "");
    let buffer = gpu.upload("not a uniform", &[0u32; 4], Usage::STORAGE)?;
    invalid(gpu.bind_group(&layout, &[&buffer, &buffer]).unwrap_err(), "not a uniform");
    // Neither is this buffer readable, nor does it have that many bytes.
    invalid(gpu.read::<u32>(&buffer, 4).unwrap_err(), "COPY_SRC");
    invalid(gpu.read::<u32>(&buffer, 5).unwrap_err(), "buffer of 16 bytes");
    // A command that is not valid, and the device afterwards.
    let submitted = gpu.run(|commands| commands.copy_buffer_to_buffer(&buffer, 0, &buffer, 0, 16));
    invalid(submitted.unwrap_err(), "");
    let work = Work::new(&gpu)?;
    gpu.run(|commands| work.record(commands, None))?;
    gpu.check()
}

#[test]
fn a_buffer_over_the_limit_is_an_error_before_anything_is_copied() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    for (usage, limit) in [(Usage::STORAGE, gpu.max_storage_bytes()), (Usage::COPY_DST, gpu.limits().max_buffer_size)] {
        let error = gpu.buffer("large", limit + 4, usage).unwrap_err();
        let device = gpu.about().name.clone();
        assert_eq!(error, DeviceError::TooLarge { device, buffer: "large".into(), bytes: limit + 4, limit });
        assert!(error.to_string().contains("\"large\" needs"), "{error}");
    }
    assert!(gpu.max_storage_bytes() <= gpu.limits().max_buffer_size);
    gpu.check()
}

#[test]
fn timestamps_advance_with_the_work() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let Some(times) = gpu.timestamps(2)? else {
        eprintln!("skipped: {} has no clock", gpu.about().name);
        return Ok(());
    };
    assert!(gpu.has_clock());
    let work = Work::new(&gpu)?;
    let start = Instant::now();
    gpu.run(|commands| {
        work.record(commands, Some(times.compute_pass(0)));
        work.record(commands, Some(times.compute_pass(1)));
        times.resolve(commands);
    })?;
    let wall = start.elapsed();
    let passes = times.read(&gpu)?;
    let (first, second, both) = (passes.span(0..=0), passes.span(1..=1), passes.span(0..=1));
    assert!(first > Duration::ZERO && second > Duration::ZERO, "{first:?} {second:?}");
    assert!(both >= first + second, "{first:?} {second:?} {both:?}");
    // The device's clock and the processor's tick at different moments.
    assert!(both <= wall + Duration::from_millis(1), "{both:?} of {wall:?}");
    Ok(())
}

#[test]
fn a_lost_device_is_an_error_everywhere() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let work = Work::new(&gpu)?;
    let times = gpu.timestamps(1)?;
    let staging = gpu.buffer("to read", 16, Usage::MAP_READ | Usage::COPY_DST)?;
    let layout = gpu.bind_group_layout("work", &[uniform(0), storage(1, false)])?;
    let module = gpu.shader("mix", MIX)?;
    gpu.device().destroy();
    let lost = |what: &str, result: Result<(), DeviceError>| match result {
        Err(DeviceError::Lost { device, .. }) => assert_eq!(device, gpu.about().name),
        other => panic!("{what}: {other:?}"),
    };
    lost("submit", gpu.run(|commands| work.record(commands, None)));
    lost("check", gpu.check());
    lost("buffer", gpu.buffer("small", 4, Usage::STORAGE).map(drop));
    lost("upload", gpu.upload("small", &[1u32], Usage::STORAGE).map(drop));
    lost("read", gpu.read::<u32>(&work.numbers, 4).map(drop));
    lost("read staging", gpu.read_staging(&staging, 16, |_| panic!("nothing was read")));
    lost("shader", gpu.shader("mix", MIX).map(drop));
    lost("layout", gpu.bind_group_layout("work", &[storage(0, true)]).map(drop));
    lost("group", gpu.bind_group(&layout, &[&work.numbers, &work.numbers]).map(drop));
    lost("pipeline", gpu.compute_pipeline(&module, "mix", &[&layout]).map(drop));
    lost("wait", gpu.wait());
    if let Some(times) = times {
        lost("timestamps", times.read(&gpu).map(drop));
        lost("new timestamps", gpu.timestamps(1).map(drop));
    }
    assert!(gpu.check().unwrap_err().to_string().contains("open it again"));
    Ok(())
}

#[test]
fn the_first_call_after_the_loss_says_so_whatever_it_is() -> Result<(), DeviceError> {
    type Call = fn(&Gpu, &wgpu::Buffer) -> Result<(), DeviceError>;
    let calls: [(&str, Call); 4] = [
        ("buffer", |gpu, _| gpu.buffer("small", 4, Usage::STORAGE).map(drop)),
        ("shader", |gpu, _| gpu.shader("mix", MIX).map(drop)),
        ("upload", |gpu, _| gpu.upload("small", &[1u32], Usage::STORAGE).map(drop)),
        ("read", |gpu, buffer| gpu.read::<u32>(buffer, 1).map(drop)),
    ];
    for (what, call) in calls {
        let Some(gpu) = gpu() else { return Ok(()) };
        let buffer = gpu.upload("number", &[1u32], Usage::STORAGE | Usage::COPY_SRC)?;
        gpu.device().destroy();
        let result = call(&gpu, &buffer);
        assert!(matches!(result, Err(DeviceError::Lost { .. })), "{what}: {result:?}");
    }
    Ok(())
}

#[test]
fn errors_of_one_thread_are_not_those_of_another() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    std::thread::scope(|threads| {
        let bad = threads.spawn(|| (0..50).all(|_| gpu.shader("broken", "fn f( {").is_err()));
        let good = threads.spawn(|| (0..50).all(|_| gpu.shader("mix", MIX).is_ok()));
        assert!(bad.join().unwrap() && good.join().unwrap());
    });
    Ok(())
}

/// What one thread waits for another may be about to deliver.
#[test]
fn threads_that_read_at_once_get_their_bytes() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let read = |thread: u32| {
        (0..300).all(|i| {
            let words = [thread, i];
            let buffer = gpu.upload("words", &words, Usage::COPY_SRC).unwrap();
            gpu.read::<u32>(&buffer, 2).unwrap() == words
        })
    };
    std::thread::scope(|threads| {
        let readers: Vec<_> = (0..6).map(|thread| threads.spawn(move || read(thread))).collect();
        assert!(readers.into_iter().all(|reader| reader.join().unwrap()));
    });
    Ok(())
}

#[test]
fn errors_on_a_device_of_the_program_are_returned_and_not_reported_to_the_program() -> Result<(), DeviceError> {
    let Some(own) = gpu() else { return Ok(()) };
    let (device, queue) = (own.device().clone(), own.queue().clone());
    let reports = Arc::new(AtomicU32::new(0));
    let counted = reports.clone();
    device.on_uncaptured_error(Arc::new(move |_| {
        counted.fetch_add(1, Ordering::Relaxed);
    }));
    let gpu = Gpu::from_device(device, queue);
    let bytes = gpu.upload("bytes", &[1u8, 2, 3, 4, 5], Usage::STORAGE | Usage::COPY_SRC)?;
    assert_eq!(gpu.read::<u8>(&bytes, 5)?, [1, 2, 3, 4, 5]);
    gpu.write(&bytes, 4, &[6; 4])?;
    assert_eq!(gpu.read::<u8>(&bytes, 5)?, [1, 2, 3, 4, 6]);
    let fixed = gpu.buffer("fixed", 16, Usage::STORAGE)?;
    assert!(matches!(gpu.write(&fixed, 0, &[0; 4]), Err(DeviceError::Invalid { .. })));
    assert!(gpu.write(&bytes, 8, &[0; 4]).is_err(), "outside of the buffer");
    assert!(matches!(gpu.begin_reading(&fixed, 16), Err(DeviceError::Invalid { .. })));
    assert!(gpu.read_staging(&fixed, 16, |_| panic!("nothing was read")).is_err());
    assert!(gpu.submit(|commands| commands.copy_buffer_to_buffer(&fixed, 0, &fixed, 0, 16)).is_err());
    assert_eq!(reports.load(Ordering::Relaxed), 0);
    gpu.check()
}

#[test]
fn devices_are_listed_best_first_and_opened_by_name() -> Result<(), DeviceError> {
    let Some(gpu) = gpu() else { return Ok(()) };
    let all = adapters();
    assert_eq!(&all[0], gpu.about());
    let software: Vec<_> = all.iter().map(|device| device.kind == DeviceKind::SoftwareGpu).collect();
    assert!(software.is_sorted(), "{all:?}");
    for device in &all {
        let part: String = device.name.to_uppercase().chars().take(4).collect();
        let opened = Gpu::open(Some(&part))?;
        assert!(opened.about().name.to_uppercase().contains(&part));
    }
    let Err(error) = Gpu::open(Some("nobody's")) else { panic!("a device that does not exist was opened") };
    assert!(matches!(&error, DeviceError::NotFound(text) if text.contains("nobody's") && text.contains(&all[0].name)));
    Ok(())
}

#[test]
fn wanted_features_are_switched_on_where_they_exist() -> Result<(), DeviceError> {
    if gpu().is_none() {
        return Ok(());
    }
    let wanted = wgpu::Features::all_webgpu_mask();
    let gpu = Gpu::open_with(None, wanted)?;
    assert!(wanted.union(wgpu::Features::TIMESTAMP_QUERY).contains(gpu.features()));
    let plain = Gpu::open(None)?;
    assert!(plain.features() == plain.features() & wgpu::Features::TIMESTAMP_QUERY);
    assert!(gpu.features().contains(plain.features()) && gpu.features() != plain.features());
    Ok(())
}
