//! scratch
use super::Outcome;
use klasktron::actuator::*;
use std::{path::PathBuf, sync::atomic::AtomicBool};
#[derive(Debug, clap::Args)]
pub(crate) struct Args { recordings: Vec<PathBuf>, #[arg(long,default_value_t=200)] epochs: usize, #[arg(long,default_value_t=256)] batch: usize, #[arg(long,default_value_t=1e-3)] lr: f64, #[arg(long,default_value_t=1)] seeds:u64, #[arg(long,default_value_t=1)] horizon:usize, #[arg(long, value_enum, default_value="cosine")] schedule: Schedule }
struct O; impl FitObserver for O { fn epoch_done(&self){} } impl FitsObserver for O { fn fit_reused(&self,_:&FitConfig){} fn fit_done(&self,_:&FitConfig){} }
pub(crate) fn run(a: &Args) -> anyhow::Result<Outcome> {
  let t=std::time::Instant::now();
  let d=load(&a.recordings, PlayerChoice::Only, ResampleConfig{target:Target::Carriage,rate_hz:50.0}, 30)?;
  eprintln!("load {:?} train {} held {} samples {}", t.elapsed(), d.train.len(), d.held_out.len(), d.train.iter().map(|r|r.len()).sum::<usize>());
  let (tr,he)=(d.train(),d.held_out());
  let t=std::time::Instant::now();
  let lag=LagDelay::fit(&tr,0.02); eprintln!("lag {:?} {:?}",lag,t.elapsed()); let t=std::time::Instant::now();
  let arx=Arx::fit(&tr,10);eprintln!("arx {:?}",t.elapsed());
  for m in [&Ideal as &dyn VelocityModel,&lag,&arx]{let j=Judgement::new(m,&he,10,0.02); eprintln!("{} one {:.5} free2 {:.5}",m.name(),j.one_step(Component::Both),j.free_running(2.0,Component::Both));}
  let cfgs:Vec<_>=(0..a.seeds).map(|seed|FitConfig{layout:LayoutKind::Klasktron,history_steps:10,width:64,hidden_layers:3,epochs:a.epochs,batch:a.batch,learning_rate:a.lr,schedule:a.schedule,horizon:a.horizon,seed}).collect();
  let store=Store::open(&PathBuf::from("/tmp/fitstore"),&d)?; let t=std::time::Instant::now();
  let fits=fit_all(&cfgs,&d,&store,(2,&AtomicBool::new(false)),&O)?;
  eprintln!("fits {:?}",t.elapsed());
  for f in &fits { let j=Judgement::new(&f.model,&he,10,0.02); let c=f.curve.last().unwrap(); eprintln!("seed {} one {:.5} free .1 {:.5} .5 {:.5} 2 {:.5} train {:.5} peak", f.config.seed,j.one_step(Component::Both),j.free_running(0.1,Component::Both),j.free_running(0.5,Component::Both),j.free_running(2.0,Component::Both),c.train_rmse_m_per_s);}
  Ok(Outcome::Done) }
