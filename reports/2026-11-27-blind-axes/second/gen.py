import numpy as np, ctypes, json, os, zlib
L=ctypes.CDLL('./sim.so')
N="M FC FV OFF KIND KT R KE LE KPV KIV KP KD TAUV RES SN DT FS VS ASYC ASYV DAHL SPR ESK ESL ESH RA RP RPH KL PA PL PS DBD SAT SLEW DELAY LAG FQ THC THT TMR TMF TMZ MP1 GA GO FFM FFV".split()
dp=ctypes.POINTER(ctypes.c_double)
def P(a): return a.ctypes.data_as(dp)
def course(m,seed,amp=1.,slow=1.):
    g=np.random.default_rng(seed); Tc=1/m['fc']; A=m['A']*amp
    def t(T): return np.arange(int(round(T*m['fc'])))*Tc
    segs=[]
    T=m['Tms']; x=t(T); f=np.exp(np.linspace(np.log(m['f1']),np.log(m['f2']),7))*np.exp(g.uniform(-.12,.12,7))*slow
    s=sum(np.sin(2*np.pi*fi*x+g.uniform(0,6.28))/fi**0.8 for fi in f)
    w=np.clip(np.minimum(x,T-x)/0.8,0,1); w=w*w*(3-2*w); s=s*w; s*=A/np.abs(s).max(); segs.append(s)
    st=np.concatenate([np.full(int(m['Tst']/7*m['fc']),g.uniform(.35,1)*(1 if i%2 else -1)*A) for i in range(6)]+[np.zeros(int(m['Tst']/7*m['fc']))])
    w0=2*np.pi*m['fst']*slow; y=st.copy()
    for _ in range(3):
        a=np.exp(-w0*Tc); o=np.empty_like(y); c=0.
        for i,val in enumerate(y): c=a*c+(1-a)*val; o[i]=c
        y=o
    segs.append(y)
    T=m['Tsl']; x=t(T); per=T/2/ (1 if slow>=1 else 1)
    sa=m['slow']*A*g.uniform(.8,1.2)*g.choice([-1,1]); tri=lambda u:2/np.pi*np.arcsin(np.sin(2*np.pi*u))
    segs.append(sa*tri(x/per)); T2=T/2; x=t(T2); segs.append(.35*sa*tri(x/(T2/3)))
    order=g.permutation(2); z=lambda T:np.zeros(int(T*m['fc']))
    r=np.concatenate([z(1.2)]+[np.concatenate([segs[i],z(.5)]) for i in order]+[segs[2],segs[3],z(1.5)])
    k=max(3,int(.02*m['fc'])); ker=np.hanning(k+2)[1:-1]; ker/=ker.sum()
    r=np.convolve(np.pad(r,(k,k),mode='edge'),ker,'same')[k:-k]
    rd=np.gradient(r,Tc); return r,rd,np.gradient(rd,Tc)
def simulate(m,chg,seed,amp=1.,slow=1.,noise=1.):
    p=dict.fromkeys(N,0.); p.update({k:m[k] for k in m if k in N}); p['FFM']=m['M'] if m['KIND']!=2 else 0
    p['KT']=p['KT'] or 1.; p['DT']=m.get('DT',5e-5)
    if m['KIND']!=2:
        w=2*np.pi*m['fb']; p['KP']=m['M']*w*w; p['KD']=max(0,1.6*m['M']*w-(m['KT']*m['KE']/m['R'] if m['KIND']==1 else 0)); p['FFV']=m['FV']
    p.update(chg); p['SN']=m['SN']*noise
    r,rd,rdd=course(m,seed,amp,slow); n=len(r); o=[np.zeros(n) for _ in range(3)]
    a=np.array([p[k] for k in N]); r,rd,rdd=map(np.ascontiguousarray,(r,rd,rdd))
    rc=L.sim(P(a),P(r),P(rd),P(rdd),n,ctypes.c_double(1/m['fc']),ctypes.c_ulonglong(seed*7919+1),P(o[0]),P(o[1]),P(o[2]))
    assert rc==0; d=int(m['fc']/m['fs']); g=np.random.default_rng(seed+5)
    u=o[1][::d]; q=o[0][::d]; ui=u*m.get('us',1)
    nz=m['un']*noise*np.std(ui); ui=ui+nz*g.standard_normal(len(ui))
    return np.arange(len(q))/m['fs'],ui,q,o[1]
def mk(**k): 
    d=dict(OFF=0.,Tms=10,Tst=7,Tsl=8,slow=.3,un=.004,TAUV=3/k['fc']); d.update(k); return d
MA={
'micro_stage':mk(KIND=0,unit='mN',pu='m',us=1e3,M=.05,FC=.04,FV=.35,OFF=.006,fs=2000,fc=2000,A=.005,f1=.4,f2=6,fst=5,fb=15,RES=1e-7,SN=5e-8,DT=2.5e-5,Tms=9,Tst=5,Tsl=5),
'printer_axis':mk(KIND=0,unit='N',pu='m',M=.45,FC=1.6,FV=4.,OFF=.1,fs=1000,fc=1000,A=.09,f1=.25,f2=4,fst=3,fb=10,RES=5e-6,SN=2e-6),
'exo_joint':mk(KIND=0,unit='Nm',pu='rad',M=.12,FC=1.2,FV=.3,OFF=-.1,fs=500,fc=500,A=.75,f1=.2,f2=3,fst=2,fb=8,RES=2*np.pi/65536,SN=3e-5),
'excavator_arm':mk(KIND=0,unit='Nm',pu='rad',M=900.,FC=260.,FV=420.,fs=100,fc=500,A=.6,f1=.08,f2=1.0,fst=.7,fb=2.5,RES=2*np.pi/16384,SN=1e-4,GA=2500.,GO=.2,Tms=14,Tst=12,Tsl=8),
'gimbal':mk(KIND=0,unit='A',pu='rad',KT=.12,M=.002,FC=.006,FV=.0012,OFF=.0005,fs=1000,fc=1000,A=.9,f1=.2,f2=4,fst=3,fb=9,RES=2*np.pi/16384,SN=8e-5),
'pick_place':mk(KIND=0,unit='A',pu='m',KT=35.,M=6.,FC=18.,FV=25.,OFF=1.5,fs=250,fc=1000,A=.28,f1=.15,f2=2.5,fst=1.6,fb=5,RES=1e-5,SN=1e-5),
'dc_cart':mk(KIND=1,unit='V',pu='m',KT=8.,KE=8.,R=1.2,LE=6e-4,M=1.5,FC=1.4,FV=.6,OFF=.1,fs=100,fc=500,A=.45,f1=.1,f2=1.6,fst=1.,fb=4,RES=5e-5,SN=3e-5,Tms=12,Tst=10),
'telescope':mk(KIND=1,unit='V',pu='rad',KT=12.,KE=12.,R=2.,LE=1e-3,M=40.,FC=6.,FV=4.,OFF=.4,fs=80,fc=400,A=.18,f1=.06,f2=.9,fst=.6,fb=1.2,RES=2*np.pi/524288,SN=6e-6,Tms=14,Tst=12,Tsl=9),
'agv_wheel':mk(KIND=2,unit='m/s',pu='m',M=40.,FC=30.,FV=22.,KPV=900.,KIV=0.,KP=2.5,fs=100,fc=500,A=.5,f1=.08,f2=1.2,fst=.9,RES=1e-4,SN=4e-5,Tms=12,Tst=11),
'conveyor':mk(KIND=2,unit='rad/s',pu='rad',M=.6,FC=2.5,FV=.8,KPV=15.,KIV=8.,KP=3.,fs=200,fc=1000,A=5.,f1=.1,f2=1.6,fst=1.,RES=2*np.pi/8192,SN=2e-4,Tms=12,Tst=10)}
def C(name,truth,expect,chg=None,**kw): return dict(case=name,truth=truth,expect=expect,chg=chg or {},kw=kw)
H={
'micro_stage':[C('mass','mass x1.25: 0.0625 kg',['gantry.inertia'],{'M':.0625}),C('presliding','Dahl presliding d=120 um, F=0.04 N',['drive.friction.presliding'],{'DAHL':1.2e-4}),C('spring','flexure k=25 N/m (25000 mN/m)',['gantry.stiffness'],{'SPR':25.})],
'printer_axis':[C('coulomb','Fc 1.6->2.5 N',['drive.friction.coulomb'],{'FC':2.5}),C('posfric','friction +0.8 sin(2pi q/0.12) N',['drive.friction.position'],{'PA':.8,'PL':.12}),C('twomass','60% load at 8 Hz, zeta .06',['drive.compliance.belt'],{'TMR':.6,'TMF':8.,'TMZ':.06})],
'exo_joint':[C('viscous','Fv 0.3->0.55',['drive.friction.viscous'],{'FV':.55}),C('endstop','stops at -0.5/+0.55 rad, 40 Nm/rad',['gantry.endstop'],{'ESK':40.,'ESL':-.5,'ESH':.55}),C('lag','first-order lag 12 ms (6 samples)',['drive.lag1','drive.current_loop'],{'LAG':.012})],
'excavator_arm':[C('coulomb','Fc 260->450 Nm',['drive.friction.coulomb'],{'FC':450.}),C('payload','gravity 2500->3300 Nm, inertia 900->1010',['gantry.inertia','drive.ripple','gantry.stiffness','gantry.tilt','drive.offset'],{'GA':3300.,'M':1010.}),C('inertiapos','M(q)=900+500 q',['gantry.mass_position'],{'MP1':500.})],
'gimbal':[C('mass','J .002->.0026',['gantry.inertia'],{'M':.0026}),C('cogging','0.006 Nm (0.05 A), period 2pi/24 rad=0.2618',['drive.ripple'],{'RA':.006,'RP':2*np.pi/24,'RPH':.7}),C('saturation','limit = 99% quantile of |u|',['drive.saturation.speed'],{'SAT':'q99'})],
'pick_place':[C('viscous','Fv 25->43',['drive.friction.viscous'],{'FV':43.}),C('loadfric','Kl=0.2',['drive.friction.load'],{'KL':.2}),C('twomass','50% load at 5 Hz, zeta .05',['drive.compliance.belt'],{'TMR':.5,'TMF':5.,'TMZ':.05})],
'dc_cart':[C('mass','M 1.5->2.3 kg',['gantry.inertia'],{'M':2.3}),C('deadband','0.8 V dead band, lost fraction 1',['drive.input_deadband'],{'DBD':.8}),C('quadratic','Fq=15 N s2/m2 (=2.25 V s2/m2)',['drive.friction.quadratic'],{'FQ':15.})],
'telescope':[C('coulomb','Fc 6->9 Nm',['drive.friction.coulomb'],{'FC':9.}),C('stribeck','Fs=5 Nm, vs=0.02 rad/s, exponent 1',['drive.friction.stribeck'],{'FS':5.,'VS':.02}),C('delay','50 ms (4 samples)',['drive.delay'],{'DELAY':.05})],
'agv_wheel':[C('mass','M 40->54 kg',['gantry.inertia','drive.velocity_controller'],{'M':54.}),C('slew','limit = 90% quantile of |dr/dt|',['drive.saturation.slew'],{'SLEW':'q90'}),C('asymmetric','Coulomb 30+-14 N, dc=28 N (0.0311 m/s)',['drive.friction.asymmetric'],{'ASYC':28.})],
'conveyor':[C('coulomb','Fc 2.5->3.8 Nm',['drive.friction.coulomb'],{'FC':3.8}),C('thermal','Coulomb -1.5 Nm with T=12 s',['drive.friction.thermal_drift'],{'THC':-1.5,'THT':12.}),C('lag','first-order lag 50 ms (10 samples)',['drive.lag1'],{'LAG':.05})]}
n3={'micro_stage':dict(noise=3.),'printer_axis':dict(amp=.6),'exo_joint':dict(slow=.6),'excavator_arm':dict(noise=3.),'gimbal':dict(amp=.6),'pick_place':dict(slow=.6),'dc_cart':dict(noise=3.),'telescope':dict(amp=.6),'agv_wheel':dict(noise=3.),'conveyor':dict(slow=.6)}
if __name__=='__main__':
    cases=[]
    for mn,m in MA.items():
        lst=[C('base','nothing hidden'+(' (gravity 2500 Nm cos(q-0.2))' if mn=='excavator_arm' else ''),[]),C('null','nothing changed',[]),C('null2','nothing changed, '+str(n3[mn]),[],**n3[mn])]+H[mn]
        for c in lst:
            d=f'data/{mn}/{c["case"]}'; os.makedirs(d,exist_ok=True); rr=[]
            for k in (1,2):
                seed=zlib.crc32(f'{mn}/{c["case"]}/{k}'.encode())%1000003
                chg=dict(c['chg'])
                for key in ('SAT','SLEW'):
                    if isinstance(chg.get(key),str):
                        qn=float(chg[key][1:])/100
                        _,_,_,uu=simulate(m,{},12345); chg[key]=float(np.quantile(np.abs(uu) if key=='SAT' else np.abs(np.diff(uu[::5]))*m['fc']/5,qn)); c['truth']+=f' = {chg[key]:.4g}' if k==1 else ''
                t,u,q,_=simulate(m,chg,seed,**c['kw']); np.savetxt(f'{d}/r{k}.csv',np.c_[t,u,q],delimiter=',',header='t,u,q',comments='',fmt='%.9g')
                rr.append((round(t[-1],1),float(np.std(u)),float(np.abs(q).max()),float(np.abs(np.gradient(q,t)).max())))
            cases.append(dict(machine=mn,kind={0:m['unit'],1:'V',2:m['unit']}[m['KIND']],pu=m['pu'],**{k:c[k] for k in('case','truth','expect')},chg={k:v for k,v in c['chg'].items()},base={k:m[k] for k in('M','FC','FV','OFF')}|{'KT':m.get('KT',1),'R':m.get('R'),'KPV':m.get('KPV')},stats=rr))
            print(mn,c['case'],rr)
    json.dump(cases,open('cases.json','w'),indent=1)
