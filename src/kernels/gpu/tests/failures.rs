//! Failures of an adapter: an error, and the CPU takes over.

use super::*;

#[test]
#[ignore = "needs an adapter"]
fn a_failing_adapter_returns_an_error_and_the_cpu_takes_over() {
    let set = set_of(
        &[[-2., -2., 0.], [2., -2., 0.], [2., 2., 0.], [-2., 2., 0.]],
        &[[0., 0., -1.], [0., 0., 1.], [9., 7., 0.5]],
        true,
    );
    let verifiers = [GpuUse::default(), GpuUse::default()];
    let cpu = || -> Box<dyn Summation> { Box::new(Direct::new(&set, Formula::Arctangent)) };
    let want = cpu().linking_number((0, 1)).integer();
    // Buffers that are too small.
    let gpu = adapter();
    gpu.lock().adapter.restrict(64);
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::<f32>::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Error::Limit(_))), "{found:?}");
    let sum = WithFallback::new(&verifiers[0], gpu.direct_sum(&set), cpu);
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
    // A lost adapter.
    let gpu = adapter();
    gpu.lock().adapter.destroy();
    let found = direct::linking_numbers(&mut gpu.lock(), &Frame::<f32>::new(&set), &[(0, 1)]);
    assert!(matches!(found, Err(Error::Failed(_))), "{found:?}");
    let sum = WithFallback::new(&verifiers[1], gpu.direct_sum(&set), cpu);
    assert_eq!(sum.linking_number((0, 1)).integer(), want);
}

/// Certificates before and after the loss of the adapter are the same, and no adapter is used
/// afterwards.
#[test]
#[ignore = "needs an adapter"]
fn a_certifier_continues_without_its_adapter() {
    let model: Model = "chainmail:rows=5,columns=6".parse().unwrap();
    let built = model.build().unwrap();
    // Other tests share the adapter under other names.
    let device = Device::Named(adapter().info().name);
    for method in [Method::Crossings, Method::Direct, Method::BarnesHut] {
        let mut certifier = on(&device, method);
        assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
        let counts = method == Method::Crossings;
        assert_eq!(certifier.offload().tests > 0, counts);
        assert!(certifier.device().is_some());
        let gpu = Gpu::shared(&device).unwrap();
        gpu.lock().adapter.destroy();
        for _ in 0..2 {
            assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
            assert_eq!(certifier.device(), None, "{method}");
            assert_eq!(certifier.offload(), Offload::default());
        }
        // A new request opens a working adapter.
        let mut certifier = on(&device, method);
        assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
        assert_eq!(certifier.offload().tests > 0, counts);
        assert!(certifier.device().is_some());
    }
}

/// Regression test: on an NVIDIA GPU no adapter was found any more after some thirty engines of one
/// process, each of which opened the adapter and closed it.
#[test]
#[ignore = "needs an adapter"]
fn an_adapter_may_be_used_by_many_engines_in_turn() {
    let built = "chainmail:rows=2,columns=2"
        .parse::<Model>()
        .unwrap()
        .build()
        .unwrap();
    for _ in 0..50 {
        let mut certifier = on(&Device::Gpu, Method::Crossings);
        assert_eq!(*certifier.certify(&built.curves).0, built.certificate);
        assert!(certifier.offload().tests > 0);
    }
}

/// The memory of an adapter is free after its last engine.
#[test]
#[ignore = "needs an adapter"]
fn the_last_engine_frees_the_memory_of_the_adapter() {
    let name = adapter().info().name;
    // A name that no other test uses.
    let device = Device::Named(name[1..].to_lowercase());
    let built = "chainmail:rows=2,columns=2"
        .parse::<Model>()
        .unwrap()
        .build()
        .unwrap();
    let bytes = || Gpu::shared(&device).unwrap().lock().adapter.bytes();
    let [mut one, other] = [0, 1].map(|_| on(&device, Method::Crossings));
    one.certify(&built.curves);
    drop(one);
    assert!(bytes() > 0);
    drop(other);
    assert_eq!(bytes(), 0);
}

#[test]
#[ignore = "needs an adapter"]
fn an_unknown_name_is_an_error_that_lists_the_adapters() {
    let error = Gpu::open(&Device::Named("no such adapter".into())).unwrap_err();
    let words = error.to_string();
    let name = adapter().info().name;
    assert!(
        words.contains("no such adapter") && words.contains(&name),
        "{words}"
    );
}
