import copy
def base(**o):
    P=dict(mx=.5,my=.9,mrot_a=.8,mrot_b=.8,kb_a=4e4,kb_b=4e4,cb_a=40,cb_b=40,gap_a=0,gap_b=0,
    fcx=2.,fsx=2.,vsx=.01,fvx=3.,fqx=0,z0x=1e-5,asx=0,fcy=2.,fsy=2.,vsy=.01,fvy=3.,fqy=0,z0y=1e-5,asy=0,
    fma=.6,fmb=.6,fva=.8,fvb=.8,z0m=8e-6,cog_a=0,cog_b=0,cogN_a=24,cogN_b=24,cogph_a=.3,cogph_b=1.9,
    kp_a=250,kp_b=250,ki_a=7000,ki_b=7000,tlim_a=195,tlim_b=195,tau_cur=.0005,pll=1000,gain_a=1,gain_b=1,off_a=0,off_b=0,delay_a=.004,delay_b=.004,lag=0,slew=0,vmax=0,dead=0,
    encstep=.04/16384,ecc_a=0,ecc_b=0,eccph=.5,tiltx=0,tilty=0,xcm=0,xcd=0,posfr=0,posL=.1,therm=0,thermT=20,loadfr=0,
    ms=.012,km=150,d0=.016,cm=.4,fst=.15,z0s=6e-5,sag=0,sagT=.01,hostkp=4,hostvmax=.45,pushT=0,pushD=0,pushFx=0,pushFy=0)
    P.update(o); return P
CAM=dict(scale=1.,rot=0.,square=0.,ox=0,oy=0,k1=0,noise=.00025,drop=.004,skew=0,lat=.003,stampjit=.0001)
MEAS=dict(cmd_hz=50,enc_hz=125,enc_ppm=20,cam_hz=120,torque_noise=.002,robot='m1')
M={
'm1':(base(mx=.45,my=1.05,mrot_a=.7,mrot_b=.72,kb_a=42e3,kb_b=40e3,fcx=2.4,fsx=2.6,vsx=.012,fvx=4,fcy=3.1,fsy=3.3,vsy=.012,fvy=5,fma=.7,fmb=.8,cog_a=.25,cog_b=.2,cogN_a=42,cogN_b=42,kp_a=260,kp_b=260,ki_a=7500,ki_b=7500,delay_a=.004,delay_b=.004,km=160,d0=.015,cm=.35,fst=.16,ms=.011,tiltx=.05),
   dict(CAM,scale=1.002,rot=.002,ox=.0004,oy=-.0003,lat=.003),dict(MEAS,cmd_hz=50,enc_hz=125,robot='m1')),
'm2':(base(mx=.7,my=1.5,mrot_a=1.1,mrot_b=1.1,kb_a=6e4,kb_b=6e4,cb_a=60,cb_b=60,fcx=3.6,fsx=3.8,vsx=.02,fvx=7,fcy=4.2,fsy=4.6,vsy=.02,fvy=9,z0x=1.5e-5,z0y=1.5e-5,fma=1.0,fmb=.9,fva=1.2,fvb=1.2,cog_a=.3,cog_b=.3,cogN_a=24,cogN_b=24,kp_a=330,kp_b=330,ki_a=12000,ki_b=12000,delay_a=.007,delay_b=.007,tau_cur=.0008,km=220,d0=.012,cm=.5,fst=.22,ms=.016,tilty=-.08),
   dict(CAM,scale=.998,rot=-.003,ox=-.0006,oy=.0002,lat=.005,noise=.0003,drop=.006),dict(MEAS,cmd_hz=60,enc_hz=200,robot='m2')),
'm3':(base(mx=.35,my=.7,mrot_a=.5,mrot_b=.5,kb_a=3e4,kb_b=3e4,cb_a=30,cb_b=30,fcx=1.6,fsx=1.7,vsx=.015,fvx=2.2,fcy=2.0,fsy=2.1,vsy=.015,fvy=2.8,fma=.5,fmb=.5,fva=.5,fvb=.5,cog_a=.12,cog_b=.12,cogN_a=14,cogN_b=14,kp_a=130,kp_b=130,ki_a=3200,ki_b=3200,delay_a=.0025,delay_b=.0025,tau_cur=.0004,km=130,d0=.018,cm=.3,fst=.11,ms=.010),
   dict(CAM,scale=1.001,rot=.001,ox=.0002,oy=.0005,lat=.002,noise=.0002,drop=.003),dict(MEAS,cmd_hz=55,enc_hz=160,robot='m3')),
}
