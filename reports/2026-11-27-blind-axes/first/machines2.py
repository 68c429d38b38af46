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
KINDS={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}
def write_cases(rows,number,seed):
    """Record the cases of set `number`: rows of (name, machine's key, machine, change, options, truth, acceptable, true parameter, reason)."""
    cases=[]
    for nm,mk,m,ov,opt,truth,alt,tp,why in rows:
        files=[]; st=[]; ov=dict(ov) if ov is not None else None; single=ov is None or bool(ov.pop('_single',0))
        for i in (1,2):
            seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov or {},seed,fn,**opt)); files.append(fn)
        x=st[0]; print(f"{nm:16s} u {x['urms']:.3g} span {x['qspan']:.3g} v {x['vrms']:.3g} max {x['vmax']:.3g} err {x['err']:.2g} still {x['still']:.2f}")
        cases.append(dict(name=nm,machine=mk,set=number,description=m['desc'],kind=KINDS.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=single,changed=ov or {},course=opt,truth=truth,acceptable=alt,true_parameter=tp,reason=why,files=files,machine_parameters=m['p'],stats=st))
    json.dump(cases,open(f'./cases{number}.json','w'),indent=1); print(len(cases))
