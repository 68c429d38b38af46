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
for k in M2: c(k+'_base2',k,None,{},MACH[k]['base'],[],M2[k]['bp'],'single set')
R='drive.'
# single sets with an effect
def s(*a): C2.append(a[:2]+(dict(a[2],_single=1),)+a[3:])
s('TTs_drag','TT',dict(FQ=.004),{},[R+'friction.quadratic'],[],'.004 Nm s2','new axis with an effect')
s('GAs_asym','GA',dict(DC=20,DV=20),{},[R+'friction.asymmetric'],[R+'offset (Coulomb part)'],'dc 20 N, dv 20 Ns/m','new axis')
s('GAs_delay','GA',dict(DELAY=.007),{},[R+'delay'],[R+'lag1'],'7 ms (+0.5 ZOH)','new axis')
s('BSs_presl','BS',dict(PD=20e-6),{},[R+'ripple.motor',R+'friction.presliding'],[],'.125 A, 20 um; ripple .03125 A','new axis, two effects')
s('BEs_load','BE',dict(KL=.12),{},[R+'friction.load'],[],'.12','new axis')
s('DCs_sat','DC',dict(USAT=13),{},[R+'saturation.speed'],[R+'saturation.torque_speed'],'13 V','new axis')
s('RVs_slew','RV',dict(SLEW=120),{},[R+'saturation.slew'],[],'120 rad/s2','new axis')
c('VC_spring2','VC',dict(K=66),{},['gantry.stiffness'],[],'5 -> 6 A/m','refit of a known effect')
c('VC_presl2','VC',dict(PD=1.5e-5,FC=.06),{},[R+'friction.presliding',R+'friction.coulomb'],[],'.00545 A, 15 um; Coulomb .0018->.0055','')
c('VC_null_noise2','VC',{},dict(noise=2),[],[],'-','noise')
c('SV_loadfric2','SV',dict(KL=.2),{},[R+'friction.load'],[],'.2','50 Hz')
c('SV_visc2','SV',dict(FV=.08),{},[R+'friction.viscous'],[],'1.0 -> 1.229 V s/rad','')
c('SV_null_course2','SV',{},dict(course='sine'),[],[],'-','')
c('GA_stribeck2','GA',dict(FS=30,VS=.02),{},[R+'friction.stribeck'],[],'30 N, .02 m/s','')
c('GA_masspos2','GA',dict(M1=20),{},['gantry.mass_position'],[],'slope 20 kg/m','')
c('GA_mass_tilt2','GA',dict(M=47,F0=-10),{},['gantry.inertia','gantry.tilt'],[R+'offset'],'42->47 kg, -10 N','two effects')
c('GA_out_local2','GA',dict(BF=-40,BQ=-.03,BW=.03),{},['unexplained'],['gantry.stiffness/ripple partly'],'local repulsion 40 N 30 mm','outside')
c('GA_null_noise2','GA',{},dict(noise=2),[],[],'-','')
c('RJ_load2','RJ',dict(KL=.12),{},[R+'friction.load'],[],'.12','')
c('RJ_delay2','RJ',dict(DELAY=.012),{},[R+'delay'],[R+'lag1'],'12 ms','')
c('RJ_tool2','RJ',dict(M=3.8,G=26),{},['gantry.inertia','gravity'],[],'3.1->3.8, 18->26 Nm','two')
c('RJ_null_start2','RJ',{},dict(off=.4,amp=.6,course='steps'),[],[],'-','')
c('PE_spring2','PE',dict(K=.2),{},['gantry.stiffness'],['ripple.motor parameter change'],'.2 Nm/rad','')
c('PE_out_cubic2','PE',dict(K3=.06),{},['unexplained'],['gantry.endstop'],'hardening spring .06 Nm/rad3','outside')
c('PE_null_course2','PE',{},dict(course='steps'),[],[],'-','')
c('BS_presl2','BS',dict(PD=20e-6),{},[R+'friction.presliding'],[],'.125 A, 20 um','')
c('BS_posfric2','BS',dict(PFA=18,PFL=.05),{},[R+'friction.position'],[],'.0375 A, 50 mm','')
c('BS_null_course2','BS',{},dict(course='sine'),[],[],'-','')
c('TT_delay2','TT',dict(DELAY=.006),{},[R+'delay'],[R+'lag1'],'6 ms','')
c('TT_drag_cog2','TT',dict(FQ=.004,RA=.12,RP=2*pi/14),{},[R+'friction.quadratic',R+'ripple.motor'],[],'.004; .12 Nm period .4488','two')
c('TT_null_course2','TT',{},dict(course='steps'),[],[],'-','')
c('BV_lag2','BV',dict(LAG=.03),{},[R+'lag1'],[R+'delay'],'30 ms','')
c('BV_tilt2','BV',dict(F0=25),{},['gantry.tilt'],[R+'offset',R+'friction.asymmetric'],'.05 m/s','')
c('BV_spring2','BV',dict(K=150),{},['gantry.stiffness'],[],'.3 1/s','')
c('BV_sat2','BV',dict(USAT=.5),{},[R+'saturation.speed'],[],'.5 m/s','')
c('BV_null_course2','BV',{},dict(course='sine'),[],[],'-','')
c('RV_lag2','RV',dict(LAG=.012),{},[R+'lag1'],[R+'delay'],'12 ms','')
c('RV_quad2','RV',dict(FQ=.01),{},[R+'friction.quadratic'],[],'.00667','')
c('RV_null_start2','RV',{},dict(off=7,course='steps'),[],[],'-','')
c('DC_sag2','DC',dict(SAG=.4/24**2),{},[R+'supply_sag'],[R+'saturation.torque_speed'],'0.4 ohm of 24 V','')
c('DC_worm2','DC',dict(KL=.2),{},[R+'friction.load'],[],'.2','')
c('DC_deadband2','DC',dict(DB=.6),{},[R+'input_deadband'],[R+'friction.coulomb'],'.6 V','')
c('DC_magnet2','DC',dict(GN=.36,KE=.63),{},['refit: inertia, Coulomb, viscous'],[],'weak magnet -10 %: J/g .075->.0833, Fc/g .625->.694, ke+ .725->.658','two coupled')
c('DC_null_course2','DC',{},dict(course='steps'),[],[],'-','')
c('BE_comp_motor2','BE',dict(ML=3,F2=8,Z2=.05),{},[R+'compliance.belt'],[],'load fraction .6, 8 Hz','encoder on the motor')
c('BE_comp_load2','BE',dict(ML=3.5,F2=8,Z2=.08,ENCLOAD=1),dict(bw=1.2),[R+'compliance.belt'],[],'resonance 14.6 Hz: T .0685 s','encoder on the load')
c('BE_endstop2','BE',dict(EK=3000,ELO=-.06),{},['gantry.endstop'],[],'3000 N/m, low -.06 m','')
c('BE_null_course2','BE',{},dict(course='steps'),[],[],'-','')
c('CR_load2','CR',dict(M=1.1e6),{},['gantry.inertia'],[],'9e5 -> 1.1e6','')
c('CR_wind2','CR',dict(F0=4e3),{},['gantry.tilt'],[R+'offset',R+'friction.asymmetric'],'4 kNm','')
c('CR_out_gust2','CR',dict(XA=8e3,XF=.35),{},['unexplained'],[],'8 kNm at .35 Hz','outside')
c('CR_null_course2','CR',{},dict(course='sine'),[],[],'-','')
cases=[]; seed=91000
for nm,mk,ov,opt,truth,alt,tp,why in C2:
    m=M2[mk]; files=[]; st=[]; ov=dict(ov) if ov is not None else None; single=ov is None or bool(ov.pop('_single',0))
    for i in (1,2):
        seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov or {},seed,fn,**opt)); files.append(fn)
    x=st[0]; print(f"{nm:16s} u {x['urms']:.3g} span {x['qspan']:.3g} v {x['vrms']:.3g} max {x['vmax']:.3g} err {x['err']:.2g} still {x['still']:.2f}")
    cases.append(dict(name=nm,machine=mk,set=2,description=m['desc'],kind={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=single,changed=ov or {},course=opt,truth=truth,acceptable=alt,true_parameter=tp,reason=why,files=files,machine_parameters=m['p'],stats=st))
json.dump(cases,open('./cases2.json','w'),indent=1); print(len(cases))
