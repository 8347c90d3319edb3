use edm_servo_head::head::*;
use edm_servo_head::settings::*;
use edm_servo_head::units::*;
use edm_sim::machine::*;
use edm_sim::process::*;
fn main() {
    let mut p = Parameters::default();
    let mut s = Settings { commissioned: true, ..Settings::default() };
    let mut depth = 0.1;
    let mut seed = 1;
    let mut verbose = false;
    for a in std::env::args().skip(1) {
        let (k, v) = a.split_once('=').unwrap();
        let val = match v {
            "true" => Value::Flag(true),
            "false" => Value::Flag(false),
            _ => v.parse::<f64>().map(Value::Number).unwrap_or(Value::Word(v)),
        };
        if k == "depth" {
            depth = v.parse().unwrap()
        } else if k == "seed" {
            seed = v.parse().unwrap()
        } else if k == "v" {
            verbose = true
        } else if p.set(k, val).is_err() {
            s.set(k, val).unwrap()
        }
    }
    let t0 = std::time::Instant::now();
    let mut m = Machine::new(&p, &s, seed).unwrap();
    for _ in 0..100 {
        m.tick();
    }
    m.command(Command::SetHome(Nanometres(0))).unwrap();
    m.command(Command::Enable).unwrap();
    m.command(Command::MoveTo(Nanometres(((2.0 + depth) * 1e6) as i64))).unwrap();
    m.command(Command::Start).unwrap();
    let (mut n, mut se, mut win, mut wn, mut wse, mut ws) = (0.0f64, 0.0f64, 0.0f64, 0, 0.0f64, 0.0f64);
    let (mut lo, mut hi) = (f64::MAX, f64::MIN);
    let mut pps = vec![];
    let mut er = 0u64;
    let (mut fs, mut fs2) = (0.0f64, 0.0f64);
    let mut retreats = 0;
    let mut g = 0.0;
    let mut k = 0u64;
    let mut last = State::Disabled;
    loop {
        if let Some(f) = m.tick() {
            let s = m.head.status();
            println!("{f:?} {:?}", s.back_emf);
        }
        k += 1;
        let st = *m.head.status();
        while let Some(c) = m.head.next_change() {
            if verbose || matches!(c.reason, Reason::Fault(_)) {
                println!("{:.4} {:?}->{:?} {:?}", k as f64 / 2e4, c.from, c.to, c.reason);
            }
            if c.to == State::Retreating {
                retreats += 1
            }
        }
        let t = m.process.truth();
        if verbose && k % 20000 == 0 {
            println!(
                "{:.1} {:?} x {:.1} surf {:.1} gap {:.1} V {:.1} duty {:.4} debris {:.2}",
                k as f64 / 2e4,
                st.state,
                t.position_um,
                t.surface_um,
                t.gap_um,
                st.gap.filtered.0,
                st.duty,
                t.debris
            );
        }
        if st.state == State::Eroding {
            er += 1;
            if er > 40000 {
                let e = (st.gap.filtered.0 - st.gap_setpoint.0) as f64;
                n += 1.0;
                se += e * e;
                fs += e;
                fs2 += e * e;
                win += e;
                wn += 1;
                g += t.gap_um;
                lo = lo.min(t.position_um);
                hi = hi.max(t.position_um);
                if wn == 2000 {
                    wse += (win / 2000.0).powi(2);
                    ws += 1.0;
                    win = 0.0;
                    wn = 0;
                }
                if er % 10000 == 0 {
                    pps.push(hi - lo);
                    lo = f64::MAX;
                    hi = f64::MIN;
                }
            }
        } else {
            win = 0.0;
            wn = 0;
            lo = f64::MAX;
            hi = f64::MIN;
        }
        if matches!(st.state, State::Done | State::Fault) || k > 20000 * 600 {
            last = st.state;
            break;
        }
    }
    let w = t0.elapsed().as_secs_f64();
    let t = m.process.truth();
    pps.sort_by(f64::total_cmp);
    let fm = fs / n;
    println!(
        "{last:?} {:?} t {:.1}s depth {:.4} count {} true {} ill {} x-rt {:.0} rms100 {:.2} filt {:.2} gap {:.1} pp_med {:.2} pp_max {:.1} retreats {} pulses {:?}",
        m.head.status().fault,
        k as f64 / 2e4,
        (t.face_um - t.first_surface_um) / 1e3,
        m.head.status().position,
        t.count,
        m.head.status().illegal_transitions,
        k as f64 / 2e4 / w,
        (wse / ws).sqrt(),
        (fs2 / n - fm * fm).sqrt(),
        g / n,
        pps[pps.len() / 2],
        pps[pps.len() - 1],
        retreats,
        t.pulses
    );
}
