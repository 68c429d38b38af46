import make,json,copy,numpy as np
from make import *
old=make.traj
def traj2(rng,T,Tc,X,V,A,fhi,course):
    q,v,a=old(rng,T,Tc,X,V,A,fhi,course); n=len(q); t=np.arange(n)*Tc; d=max(.5,2*V/A)
    w=np.clip((T-.2-t)/d,0,1); w=w*w*(3-2*w); v=np.gradient(q,Tc)*w; q=q[0]+np.cumsum(v)*Tc
    return q,v,np.gradient(v,Tc)
make.traj=traj2
M2=copy.deepcopy(MACH)
def mod(k,fs=None,iu=None,pu=None,**p):
    M2[k]['p'].update(p)
    if fs: M2[k]['fs']=fs
    if iu: M2[k]['iu']=iu
    if pu: M2[k]['pu']=pu
mod('VC',fs=2000,iu='A',pu='mm',M=.02,K=55,FV=.5,GN=11,FC=.02); M2['VC']['T']=15
mod('SV',fs=50,M=.02,GN=.35,KE=1.0,FC=.2); M2['SV']['ctrl']=10
mod('GA',fs=500,pu='m',M=42,FC=60,FV=70,UN=1); M2['GA']['ctrl']=2
mod('RJ',fs=125,pu='deg',M=3.1,FC=14,FV=22,G=18,UN=.2); M2['RJ']['ctrl']=8
mod('PE',fs=250,iu='Nm',M=.009,G=.4,FC=.01,FV=.006); M2['PE']['ctrl']=4
mod('BS',fs=800,pu='mm',M=180,GN=480,FC=60,FV=600,RA=15,RP=.01/8,ENCQ=1e-7)
mod('TT',fs=200,iu='mNm',M=.12,FC=.15,FV=.03,UN=.01); M2['TT']['ctrl']=5
mod('BV',fs=100,M=11,KP=500,KI=4000,FC=20,FV=25,ENCQ=5e-6); M2['BV']['ctrl']=5
mod('RV',fs=250,M=.05,KP=1.5,FC=.2,FV=.08); 
mod('DC',fs=250,M=.03,GN=.4,KE=.7,FC=.25,FV=.01); M2['DC']['ctrl']=2
mod('BE',fs=500,pu='mm',M=5,FC=8,FV=10,UN=.2); M2['BE']['ctrl']=2; M2['BE']['fhi']=30
mod('CR',fs=100,M=9e5,FC=5e3,FV=2e4); M2['CR']['ctrl']=5
for k in M2:
    p=M2[k]['p']; g=p.get('KP',p.get('GN',1)) if p.get('MODE',0)==2 else p.get('GN',1)
    M2[k]['bp']='in input units: '+', '.join(f'{x} {p[x]/g:.4g}' for x in('M','FC','FV','K','G','RA') if x in p)+(f", ke {p['KE']}" if 'KE' in p else '')+(f", period {p['RP']:.5g}" if 'RP' in p else '')+(f", rho {p['KI']/p['KP']:.3g}" if 'KI' in p else '')
C2=[]
def c(*a): C2.append(a)
R='drive.'
M1=MACH
def run(nm,mk,mm,ov,opt,truth,tp):
    C2.append((nm,mk,mm,ov,opt,truth,tp))
run('GA_stribeck4','GA',M2,dict(FS=30,VS=.02),dict(course='slow'),[R+'friction.stribeck'],'30 N .02 m/s, slow motion with many reversals')
run('GA_stribeck5','GA',M2,dict(FS=30,VS=.08),{},[R+'friction.stribeck'],'30 N .08 m/s')
run('DC_worm4','DC',M2,dict(KL=.1),{},[R+'friction.load'],'.1 of motor torque')
run('GA_load4','GA',M2,dict(KL=.1),{},[R+'friction.load'],'.1')
run('TT_load4','TT',M2,dict(KL=.1),{},[R+'friction.load'],'.1')
run('BE_comp12','BE',M2,dict(ML=3,F2=12,Z2=.05),{},[R+'compliance.belt'],'.6, 12 Hz (500 Hz)')
run('BE_comp16','BE',M2,dict(ML=3,F2=16,Z2=.05),{},[R+'compliance.belt'],'.6, 16 Hz (500 Hz)')
run('BE_comp_load4','BE',M2,dict(ML=1.5,F2=18,Z2=.08,ENCLOAD=1),dict(bw=1.2),[R+'compliance.belt'],'load encoder, 18*sqrt(5/3.5)=21.5 Hz')
run('RV_lag4','RV',M2,dict(LAG=.03),{},[R+'lag1'],'30 ms')
run('BV_lag4','BV',M2,dict(LAG=.06),{},[R+'lag1'],'60 ms')
run('TT_jit4','TT',M2,{},dict(jit=1e-5),[],'10 us jitter')
run('BE_coul_visc4','BE',M2,dict(FC=12,FV=16),{},[R+'friction.coulomb',R+'friction.viscous'],'8->12, 10->16')
run('BS_presl4','BS',M2,dict(PD=5e-6),{},[R+'friction.presliding'],'.125 A 5 um')
run('DC_stribeck4','DC',M2,dict(FS=.3,VS=.8),{},[R+'friction.stribeck'],'.75 V, .8 rad/s')
run('DC_asym4','DC',M2,dict(DC=.16),{},[R+'offset'],'+-.2 V -> offset .2 V')
run('DC_spring4','DC',M2,dict(K=.15),{},['gantry.stiffness'],'.375 V/rad')
run('DC_cog4','DC',M2,dict(RA=.2,RP=2*pi/7,RPH=.3),{},[R+'ripple.motor'],'.5 V, period .8976')
run('CR_thermal4','CR',M2,dict(THC=-2.5e3,THT=20),{},[R+'friction.thermal_drift'],'-2500, 20 s')
run('VC_gravity4','VC',M2,dict(F0=.1962),{},['gantry.tilt'],'.01784 A')
run('VC_endstop4','VC',M2,dict(EK=4000,EHI=.0015),{},['gantry.endstop'],'363.6 A/m from 1.5 mm')
run('GA_slew_current','GA',M2,dict(USAT=260),{},[R+'saturation.speed'],'260 N amplifier limit')
run('RV_cog4','RV',M2,dict(RA=.25,RP=2*pi/6,RPH=.3),{},[R+'ripple.motor'],'.1667 rad/s, period 1.047')
run('RV_tilt4','RV',M2,dict(F0=.3),{},['gantry.tilt'],'.2 rad/s')
cases=[];seed=330000
for nm,mk,mm,ov,opt,truth,tp in C2:
    m=mm[mk];files=[];st=[]
    for i in (1,2):
        seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov,seed,fn,**opt)); files.append(fn)
    x=st[0]; print(nm,x)
    cases.append(dict(name=nm,machine=mk,set=4,description=m['desc'],kind={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=False,changed=ov,course=opt,truth=truth,acceptable=[],true_parameter=tp,reason='',files=files,machine_parameters=m['p'],stats=st))
json.dump(cases,open('./cases4.json','w'),indent=1)
