from machines2 import *

R='drive.'
for k in M2:
    p=M2[k]['p']; vel=p.get('MODE',0)==2
    c(k+'_r3_repeat',k,{},{},[],[],'-','null: same kind of motion, new seeds')
    c(k+'_r3_noise',k,{},dict(noise=1),[],[],'-','null: white encoder noise of one quantum rms added') if False else c(k+'_r3_noise',k,dict(ENCN=.7*p['ENCQ']),{},[],[],'-','null: white encoder noise of 0.7 quantum rms added')
    c(k+'_r3_slow',k,{},dict(course='slow'),[],[],'-','null: slow motion only')
    c(k+'_r3_coulomb',k,dict(FC=1.4*p['FC']),{},[R+'friction.coulomb'],[],'+40 %','')
    c(k+'_r3_mass',k,dict(M=1.08*p['M']),{},['drive.velocity_controller' if vel else 'gantry.inertia'],[],'+8 %','')
    c(k+'_r3_delay',k,dict(DELAY=1.5/M2[k]['fs']),{},[R+'delay'],[R+'lag1',R+'current_loop'],'%.4g s'%(1.5/M2[k]['fs']),'')
cases=[]; seed=170500
for nm,mk,ov,opt,truth,alt,tp,why in C2:
    m=M2[mk]; files=[]; st=[]; ov=dict(ov) if ov is not None else None; single=ov is None or bool(ov.pop('_single',0))
    for i in (1,2):
        seed+=1; fn=f'./csv/{nm}-{i}.csv'; st.append(record(m,ov or {},seed,fn,**opt)); files.append(fn)
    x=st[0]; print(f"{nm:16s} u {x['urms']:.3g} span {x['qspan']:.3g} v {x['vrms']:.3g} max {x['vmax']:.3g} err {x['err']:.2g} still {x['still']:.2f}")
    cases.append(dict(name=nm,machine=mk,set=3,description=m['desc'],kind={'V':'voltage','duty':'voltage (duty)','A':'current','mA':'current','mm/s':'velocity setpoint','rpm':'velocity setpoint'}.get(m['iu'],'force/torque'),input_unit=m['iu'],position_unit=m['pu'],rate_hz=m['fs'],seconds=m['T'],single=single,changed=ov or {},course=opt,truth=truth,acceptable=alt,true_parameter=tp,reason=why,files=files,machine_parameters=m['p'],stats=st))
json.dump(cases,open('./cases3.json','w'),indent=1); print(len(cases))
