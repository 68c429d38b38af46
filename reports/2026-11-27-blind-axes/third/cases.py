import json,subprocess,sys,os
AX={}
def ax(n,desc,p,imp): AX[n]=dict(desc=desc,p=p,imp=imp)
ax("A1","ball-screw stage, force N, 1 kHz, M=25 kg B=80 Ns/m Fc=12 N, 0.5 um encoder, force noise 0.4 N, PD+FF position loop",
 "fs=1000 T=15 M=25 B=80 Fc=12 c=1 amp=0.15 spd=0.3 acc=3 hold=0.2 cl=1 Kp=24700 Kd=1100 Mff=25 tf=0.002 yq=5e-7 un=0.4 dis=0.5 yfac=1000","--time t --input u:N --position y:mm")
ax("A2","voice coil, current (mA), 4 kHz, M=0.044 A s2/m B=0.19 A s/m Fc=0.02 A, 10 nm interferometer, current noise 3 mA, 0.3 ms amplifier lag",
 "fs=4000 T=8 sub=10 M=0.044 B=0.19 Fc=0.02 c=2 amp=1.5e-3 f0=0.7 f1=25 spd=0.7 cl=1 Kp=250 Kd=4.6 Mff=0.044 tf=0.0003 yq=1e-8 yn=2e-8 un=0.003 te=0.0003 ufac=1000 yfac=1e6","--time t --input u:mA --position y:um")
ax("A3","harmonic-drive joint, torque Nm, 500 Hz, J=1.2 B=4 Fc=3 Nm, 20 urad encoder, torque noise 0.1 Nm",
 "fs=500 T=24 M=1.2 B=4 Fc=3 c=1 amp=1.0 spd=1.5 acc=8 hold=0.3 cl=1 Kp=426 Kd=36 Mff=1.2 tf=0.004 yq=2e-5 un=0.1 dis=0.1 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("A4","DC gear motor, duty of 12 V, 200 Hz, M=0.029 V s2/rad B=0.05 ke=0.43 V s/rad Fc=1 V L/R=2 ms, 1200 counts/turn, 8 bit PWM, PRBS open loop",
 "fs=200 T=40 sub=40 mode=1 M=0.029 B=0.05 ke=0.43 Fc=1.0 te=0.002 c=4 amp=10 spd=0.8 hold=0.2 yq=0.0052359878 uq=0.047 ufac=0.0833333333 yfac=190.985932","--time t --input u:duty --supply-v 12 --position y:counts --counts-per-turn 1200")
ax("A5","gimbal yaw, torque mNm, 250 Hz, J=0.012 B=0.004 Fc=0.006 Nm, 0.2 mrad position noise, torque noise 0.5 mNm",
 "fs=250 T=30 M=0.012 B=0.004 Fc=0.006 c=6 amp=0.9 hold=0.5 f0=1.0 cl=1 Kp=1.9 Kd=0.21 Mff=0.012 tf=0.01 yn=2e-4 un=0.0005 ufac=1000 yfac=1000","--time t --input u:mNm --position y:mrad")
ax("A6","belt conveyor, velocity setpoint m/min, PI loop T=0.08 s rho=3/s, 100 Hz, B=0.1 Fc=0.03 m/s, 0.1 mm encoder, step ladder",
 "fs=100 T=45 sub=50 mode=2 M=0.08 B=0.1 Fc=0.03 rho=3 c=5 amp=0.5 hold=0.7 yq=1e-4 ufac=60 yfac=1000","--time t --input u:m/min --position y:mm")
ax("A7","pendulum arm, torque Nm, 400 Hz, J=0.35 B=0.3 Fc=0.25 mgl=6 Nm, 0.3 mrad encoder, torque noise 0.05",
 "fs=400 T=20 M=0.35 B=0.3 Fc=0.25 gA=6 c=1 amp=1.3 spd=2.5 acc=12 hold=0.2 cl=1 Kp=124 Kd=10.6 Mff=0.35 tf=0.005 yq=3.14159e-4 un=0.05 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("A8","hydraulic piston, velocity setpoint mm/s, P loop T=0.04 s valve lag 4 ms, 250 Hz, B=0.2 Fc=8 mm/s, 2 um encoder, multisine",
 "fs=250 T=24 sub=30 mode=2 M=0.04 B=0.2 Fc=0.008 te=0.004 c=2 amp=0.15 f0=0.2 f1=8 spd=0.4 yq=2e-6 un=0.0003 ufac=1000 yfac=1000","--time t --input u:mm/s --position y:mm")
ax("A9","reaction wheel, current A, 50 Hz, M=0.032 A s2/rad B=2e-4 A s/rad Fc=0.1 A, 4096/turn, current noise 4 mA, position in turns",
 "fs=50 T=60 sub=60 M=0.032 B=2e-4 Fc=0.1 c=2 amp=50 f0=0.1 f1=1.0 spd=1.2 cl=1 Kp=0.114 Kd=0.1 Mff=0.032 yq=0.00153398 un=0.004 yfac=0.159154943","--time t --input u:A --position y:turns")
ax("A10","linear motor with cogging (0.12 A, 24 mm), current A, 2 kHz, M=0.15 A s2/m B=0.5 Fc=0.2 A, 0.1 um, current noise 10 mA, 0.5 ms current loop",
 "fs=2000 T=10 M=0.15 B=0.5 Fc=0.2 rA=0.12 rP=0.024 te=0.0005 c=1 amp=0.2 spd=0.8 acc=8 hold=0.15 cl=1 Kp=592 Kd=13 Mff=0.15 tf=0.001 yq=1e-7 un=0.01 yfac=1000","--time t --input u:A --position y:mm")
ax("A11","exo joint with spring 5 Nm/rad, torque Nm, 333 Hz, J=0.25 B=0.8 Fc=0.6, 14 bit encoder, torque noise 0.05, multisine closed loop",
 "fs=333.3333333 T=24 M=0.25 B=0.8 Fc=0.6 K=5 q0=0.4 c=2 amp=0.5 f0=0.2 f1=4 spd=1.0 cl=1 Kp=62 Kd=6.3 Mff=0.25 tf=0.005 yq=3.835e-4 un=0.05 yfac=57.29577951","--time t --input u:Nm --position y:deg")
ax("A12","3D-printer stepper axis, velocity command mm/s, lag T=8 ms, 1 kHz, B=0.02 Fc=1.5 mm/s, 5 um encoder, chirps",
 "fs=1000 T=14 mode=2 M=0.008 B=0.02 Fc=0.0015 te=0.001 c=3 amp=0.12 f0=0.5 f1=25 hold=7 spd=0.25 yq=5e-6 ufac=1000 yfac=1000","--time t --input u:mm/s --position y:mm")
BASE={"A7":["gantry.gravity"],"A10":["drive.ripple.motor"],"A11":["gantry.stiffness"],"A8":["drive.current_loop|drive.lag1|drive.delay"],"A12":["drive.current_loop|drive.lag1|drive.delay"]}
R="refit:"   # known parameter change
C=[]
def c(a,name,kind,mod,accept,par=None,course=""): C.append(dict(id=f"{a}-{name}",axis=a,kind=kind,mod=mod,accept=accept,par=par or {},course=course))
for a in AX: c(a,"ref","reference","",BASE.get(a,[]))
N="null"
c("A1","null",N,"",[],course="amp=0.1 spd=0.22 acc=2.2"); c("A2","null",N,"",[],course="c=1 amp=1.5e-3 spd=0.05 acc=4 hold=0.03"); c("A3","null",N,"",[],course="c=2 amp=0.6 f0=0.15 f1=2.5 spd=1")
c("A4","null",N,"",[],course="c=5 amp=10 hold=0.4"); c("A5","null",N,"",[],course="c=1 amp=0.7 spd=2 acc=8 hold=0.1"); c("A6","null",N,"",[],course="c=4 amp=0.4 hold=0.5 spd=0.9")
c("A7","null",N,"",[],course="amp=1.0 spd=1.8"); c("A8","null",N,"",[],course="c=4 amp=0.15 hold=0.3 spd=0.9"); c("A9","null",N,"",[],course="amp=35"); c("A10","null",N,"",[],course="amp=0.15 spd=0.6 acc=10")
c("A11","null",N,"",[],course="c=6 amp=0.9 hold=0.7 f0=1"); c("A12","null",N,"",[],course="c=1 amp=0.1 spd=0.15 acc=2 cl=2 Kp=2 hold=0.1")
s="single"
c("A1","load",s,"Kl=0.12",["drive.friction.load"],{"coefficient":0.12})
c("A1","ripple",s,"drA=4 drP=0.010",["drive.ripple.motor"],{"period_m":0.010})
c("A1","compliance",s,"lf=0.4 cf=30 cz=0.04",["drive.compliance.belt"],{"load_fraction":0.4,"frequency_hz":30},course="dit=30 df0=5 df1=70")
c("A2","spring",s,"dK=30",["gantry.stiffness"],{"stiffness_n_per_m":30})
c("A2","delay",s,"delay=0.001",["drive.delay"],{"delay_s":0.001})
c("A3","stribeck",s,"Fs=2.5 vs=0.12",["drive.friction.stribeck"],{"force_n":2.5,"velocity_m_per_s":0.12})
c("A3","gravity",s,"dgA=4 dgB=1.5",["gantry.gravity"],{"sine_n":4,"cosine_n":1.5})
c("A3","compliance",s,"lf=0.6 cf=7 cz=0.05",["drive.compliance.belt"],{"load_fraction":0.6,"frequency_hz":7})
c("A4","deadband",s,"db=1.2 dbs=0",["drive.input_deadband"],{"threshold":1.2},course="c=5 amp=8 hold=0.35")
c("A4","sat",s,"sat=6",["drive.saturation.speed"],{"limit_m_per_s":6})
c("A4","lag",s,"lag=0.03",["drive.lag1"],{"time_constant_s":0.03})
c("A5","quadratic",s,"bq=0.006",["drive.friction.quadratic"],{"coefficient_n_s2_per_m2":0.006})
c("A5","unbalance",s,"dtilt=0.01",["gantry.tilt","drive.offset",R+"offset"],{"force_n":0.01})
c("A5","delay",s,"delay=0.02",["drive.delay"],{"delay_s":0.02})
c("A6","slew",s,"slew=1.0",["drive.saturation.slew"],{"limit_m_per_s2":1.0})
c("A6","delay",s,"delay=0.08",["drive.delay"],{"delay_s":0.08})
c("A6","asym",s,"adc=0.08",["drive.friction.asymmetric"],{"coulomb_difference_n":0.08})
c("A3","presliding",s,"pre=0.03",["drive.friction.presliding"],{"force_n":3,"distance_m":0.03})
c("A7","posfriction",s,"pS=0.4 dFc=0.3",["drive.friction.position"],{"slope_n_per_m":0.4})
c("A7","payload",s,"dgA=1.5 dM=0.06",["refit:gravity+inertia"],{})
c("A8","deadband",s,"db=0.02",["drive.input_deadband"],{"threshold":0.02})
c("A8","asym",s,"adv=0.3",["drive.friction.asymmetric"],{"viscous_difference_n_s_per_m":0.3})
c("A9","thermal",s,"dFc=0.4 th=-0.4 thT=15",["drive.friction.thermal_drift"],{"time_constant_s":15})
c("A9","delay",s,"delay=0.08",["drive.delay"],{"delay_s":0.08})
c("A10","massposition",s,"m1=0.3",["gantry.mass_position"],{"slope_kg_per_m":0.3})
c("A10","endstop",s,"es=20 eh=0.12 el=-0.13",["gantry.endstop"],{"stiffness_n_per_m":20})
c("A11","lag",s,"lag=0.02",["drive.lag1"],{"time_constant_s":0.02})
c("A11","asym",s,"adc=0.7",["drive.friction.asymmetric"],{"coulomb_difference_n":0.7})
c("A12","slew",s,"slew=4",["drive.saturation.slew"],{"limit_m_per_s2":4})
c("A12","lag",s,"lag=0.01",["drive.lag1"],{"time_constant_s":0.01})
c("A9","backlash",s,"lf=0.5 cf=12 cz=0.3 gap=1.0",["UNEXPLAINED","drive.backlash"])
c("A12","jitter",s,"jit=0.0004",["UNEXPLAINED","NONE"])
d="double"
c("A1","asym+ripple",d,"adc=14 drA=4 drP=0.010",["drive.friction.asymmetric","drive.ripple.motor"],{"coulomb_difference_n":14,"period_m":0.01})
c("A2","spring+delay",d,"dK=30 delay=0.001",["gantry.stiffness","drive.delay"],{"stiffness_n_per_m":30,"delay_s":0.001})
c("A3","inertia+load",d,"dM=0.3 Kl=0.15",["refit:inertia","drive.friction.load"],{"coefficient":0.15})
c("A5","delay+tilt",d,"delay=0.02 dtilt=0.01",["drive.delay","gantry.tilt|drive.offset|refit:offset"],{"delay_s":0.02})
c("A6","delay+asym",d,"delay=0.08 adc=0.08",["drive.delay","drive.friction.asymmetric"],{"delay_s":0.08,"coulomb_difference_n":0.08})
c("A7","load+delay",d,"Kl=0.1 delay=0.012",["drive.friction.load","drive.delay"],{"coefficient":0.1,"delay_s":0.012})
c("A8","spring+delay",d,"dK=0.6 delay=0.02",["gantry.stiffness","drive.delay"],{"stiffness_n_per_m":0.6,"delay_s":0.02})
c("A10","delay+quadratic",d,"delay=0.003 bq=0.8",["drive.delay","drive.friction.quadratic"],{"delay_s":0.003,"coefficient_n_s2_per_m2":0.8})
c("A11","endstop+viscous",d,"es=25 eh=0.35 el=-0.35 dB=0.4",["gantry.endstop","refit:viscous"],{"stiffness_n_per_m":25})
c("A12","deadband+delay",d,"db=0.008 delay=0.006",["drive.input_deadband","drive.delay"],{"threshold":0.008,"delay_s":0.006})
